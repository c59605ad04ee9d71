/* Main function of the firmware: received bytes and CAN frames in, pulses and reports out. */

#include "uuv_hil_stm32.h"

static void set_outputs(const UuvHilFirmware *firmware)
{
    const UuvHilPlatform *platform = firmware->platform;
    platform->pwm_set(platform->context, firmware->board.pwm_us, firmware->board.channels);
}

static uint16_t line_errors(const UuvHilFirmware *firmware)
{
    switch (firmware->protocol) {
    case UUV_HIL_PROTOCOL_MAVLINK:
        return firmware->mavlink.packets.checksum_errors;
    case UUV_HIL_PROTOCOL_VESC:
        return firmware->vesc.malformed;
    default:
        return (uint16_t)(firmware->frames.checksum_errors + firmware->malformed);
    }
}

static void report_in_frame(const UuvHilPlatform *platform, const UuvHilTelemetry *telemetry)
{
    uint8_t bytes[UUV_HIL_FRAME_TELEMETRY_FRAME_SIZE_MAX];
    size_t size = uuv_hil_frame_encode(telemetry, bytes);
    platform->uart_write(platform->context, bytes, size);
}

static void report_as_vescs(const UuvHilPlatform *platform, const UuvHilTelemetry *telemetry)
{
    for (uint8_t i = 0; i < telemetry->channels; i++) {
        UuvHilCanFrame status = uuv_hil_vesc_status(i, telemetry->pwm_us[i]);
        platform->can_write(platform->context, &status);
    }
}

static void report(UuvHilFirmware *firmware, uint64_t now_us)
{
    firmware->board.line_errors = line_errors(firmware);
    UuvHilTelemetry telemetry = uuv_hil_board_telemetry(&firmware->board, now_us);
    if (firmware->protocol == UUV_HIL_PROTOCOL_MAVLINK)
        uuv_hil_mavlink_report(&firmware->mavlink, firmware->platform, &telemetry, now_us);
    else if (firmware->protocol == UUV_HIL_PROTOCOL_VESC)
        report_as_vescs(firmware->platform, &telemetry);
    else
        report_in_frame(firmware->platform, &telemetry);
}

void uuv_hil_start(UuvHilFirmware *firmware, const UuvHilPlatform *platform, uint8_t channels, uint32_t watchdog_us)
{
    *firmware = (UuvHilFirmware){.platform = platform};
    uuv_hil_board_start(&firmware->board, channels, watchdog_us);
    uuv_hil_mavlink_start(&firmware->mavlink, channels);
    uuv_hil_vesc_start(&firmware->vesc, channels);
    set_outputs(firmware);
}

static UuvHilReceived feed_frame(UuvHilFirmware *firmware, uint8_t byte, UuvHilCommand *command)
{
    const uint8_t *frame = uuv_hil_stream_feed(&firmware->frames, &uuv_hil_frame_format, byte);
    if (frame == NULL)
        return UUV_HIL_NOTHING;
    if (uuv_hil_frame_decode(frame, command))
        return UUV_HIL_COMMAND;
    firmware->malformed++;
    return UUV_HIL_VALID;
}

static void set_protocol(UuvHilFirmware *firmware, UuvHilProtocol protocol)
{
    if (protocol != UUV_HIL_PROTOCOL_MAVLINK)
        firmware->mavlink.command.armed = false; /* a sender that returns to MAVLink has to arm again */
    firmware->protocol = protocol;
}

static UuvHilReceived feed_byte(UuvHilFirmware *firmware, uint8_t byte, uint64_t now_us, UuvHilCommand *command)
{
    UuvHilReceived frame = feed_frame(firmware, byte, command);
    if (frame != UUV_HIL_NOTHING) {
        set_protocol(firmware, UUV_HIL_PROTOCOL_FRAME);
        return frame;
    }
    UuvHilReceived packet = uuv_hil_mavlink_feed(&firmware->mavlink, firmware->platform, byte, now_us, command);
    if (packet != UUV_HIL_NOTHING)
        set_protocol(firmware, UUV_HIL_PROTOCOL_MAVLINK);
    return packet;
}

static void apply_command(UuvHilFirmware *firmware, const UuvHilCommand *command, uint64_t now_us)
{
    if (!uuv_hil_board_command(&firmware->board, command, now_us))
        return;
    set_outputs(firmware);
    report(firmware, now_us);
}

void uuv_hil_receive_can(UuvHilFirmware *firmware, const UuvHilCanFrame *frame)
{
    uint64_t now_us = firmware->platform->now_us(firmware->platform->context);
    UuvHilCommand command;
    UuvHilReceived received = uuv_hil_vesc_receive(&firmware->vesc, frame, now_us, &command);
    if (received != UUV_HIL_NOTHING)
        set_protocol(firmware, UUV_HIL_PROTOCOL_VESC);
    if (received == UUV_HIL_COMMAND)
        apply_command(firmware, &command, now_us);
}

static void advance_time(UuvHilFirmware *firmware, uint64_t now_us)
{
    if (uuv_hil_board_tick(&firmware->board, now_us)) {
        set_outputs(firmware);
        report(firmware, now_us);
    }
    if (firmware->protocol == UUV_HIL_PROTOCOL_MAVLINK)
        uuv_hil_mavlink_tick(&firmware->mavlink, firmware->platform, now_us);
}

void uuv_hil_service(UuvHilFirmware *firmware, const uint8_t *bytes, size_t size)
{
    const UuvHilPlatform *platform = firmware->platform;
    uint64_t now_us = platform->now_us(platform->context);
    for (size_t i = 0; i < size; i++) {
        UuvHilCommand command;
        if (feed_byte(firmware, bytes[i], now_us, &command) == UUV_HIL_COMMAND)
            apply_command(firmware, &command, now_us);
    }
    advance_time(firmware, now_us);
    platform->watchdog_kick(platform->context);
}

uint64_t uuv_hil_deadline_us(const UuvHilFirmware *firmware)
{
    uint64_t board_us = uuv_hil_board_deadline_us(&firmware->board);
    uint64_t heartbeat_us = firmware->mavlink.heartbeat_due_us;
    return firmware->protocol == UUV_HIL_PROTOCOL_MAVLINK && heartbeat_us < board_us ? heartbeat_us : board_us;
}

void uuv_hil_stop(UuvHilFirmware *firmware)
{
    uuv_hil_board_disarm(&firmware->board);
    set_outputs(firmware);
}
