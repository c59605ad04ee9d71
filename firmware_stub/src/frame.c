/* The binary frame: hil/links/frame/protocol.py for the one layout of frames/uuv_hil.toml. */

#include "uuv_hil_stm32.h"

#define FRAME_PREFIX UUV_HIL_FRAME_PAYLOAD /* sync, length, id */

_Static_assert(UUV_HIL_FRAME_CRC_POLYNOMIAL == 0x1021u, "eight bits at once are these shifts for no other polynomial");

uint16_t uuv_hil_crc16(const uint8_t *data, size_t size)
{
    uint32_t crc = UUV_HIL_FRAME_CRC_START_VALUE;
    for (size_t i = 0; i < size; i++) {
        uint32_t byte = (crc >> 8 ^ data[i]) & 0xFFu;
        byte ^= byte >> 4;
        crc = crc << 8 ^ byte << 12 ^ byte << 5 ^ byte;
    }
    return (uint16_t)crc;
}

static uint16_t get_u16(const uint8_t *from)
{
    return (uint16_t)(from[0] | from[1] << 8);
}

static void put_u16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)value;
    to[1] = (uint8_t)(value >> 8);
}

static void put_u32(uint8_t *to, uint32_t value)
{
    put_u16(to, (uint16_t)value);
    put_u16(to + 2, (uint16_t)(value >> 16));
}

static uint16_t checksum(const uint8_t *frame, size_t size)
{
    return uuv_hil_crc16(frame + UUV_HIL_FRAME_CRC_START, size - UUV_HIL_FRAME_CRC_START - UUV_HIL_FRAME_CRC_SIZE);
}

static size_t frame_size(const uint8_t *bytes, size_t available)
{
    if (available < 2)
        return 2;
    if (bytes[1] != UUV_HIL_FRAME_SYNC_1)
        return 0;
    if (available < FRAME_PREFIX)
        return FRAME_PREFIX;
    return FRAME_PREFIX + (size_t)bytes[UUV_HIL_FRAME_LENGTH] + UUV_HIL_FRAME_CRC_SIZE;
}

static bool is_valid(const uint8_t *frame, size_t size)
{
    return checksum(frame, size) == get_u16(frame + size - UUV_HIL_FRAME_CRC_SIZE);
}

const UuvHilFormat uuv_hil_frame_format = {frame_size, is_valid, UUV_HIL_FRAME_SYNC_0};

bool uuv_hil_frame_decode(const uint8_t *frame, UuvHilCommand *command)
{
    uint8_t channels = frame[UUV_HIL_FRAME_COMMAND_COUNT];
    if (frame[UUV_HIL_FRAME_ID] != UUV_HIL_FRAME_COMMAND_ID || channels < 1 || channels > UUV_HIL_MAX_CHANNELS
        || frame[UUV_HIL_FRAME_LENGTH] != UUV_HIL_FRAME_COMMAND_PAYLOAD_SIZE(channels))
        return false;
    command->sequence = get_u16(frame + UUV_HIL_FRAME_COMMAND_SEQUENCE);
    command->armed = (frame[UUV_HIL_FRAME_COMMAND_FLAGS] & UUV_HIL_FRAME_COMMAND_ARMED) != 0;
    command->channels = channels;
    for (uint8_t i = 0; i < channels; i++)
        command->pwm_us[i] = get_u16(frame + UUV_HIL_FRAME_COMMAND_PWM_US + 2u * i);
    return true;
}

size_t uuv_hil_frame_encode(const UuvHilTelemetry *telemetry, uint8_t *out)
{
    size_t size = UUV_HIL_FRAME_TELEMETRY_FRAME_SIZE(telemetry->channels);
    unsigned flags = (telemetry->armed ? UUV_HIL_FRAME_TELEMETRY_ARMED : 0u)
        | (telemetry->timed_out ? UUV_HIL_FRAME_TELEMETRY_TIMED_OUT : 0u);
    out[0] = UUV_HIL_FRAME_SYNC_0;
    out[1] = UUV_HIL_FRAME_SYNC_1;
    out[UUV_HIL_FRAME_LENGTH] = (uint8_t)UUV_HIL_FRAME_TELEMETRY_PAYLOAD_SIZE(telemetry->channels);
    out[UUV_HIL_FRAME_ID] = UUV_HIL_FRAME_TELEMETRY_ID;
    put_u16(out + UUV_HIL_FRAME_TELEMETRY_SEQUENCE, telemetry->sequence);
    out[UUV_HIL_FRAME_TELEMETRY_FLAGS] = (uint8_t)flags;
    out[UUV_HIL_FRAME_TELEMETRY_COUNT] = telemetry->channels;
    put_u32(out + UUV_HIL_FRAME_TELEMETRY_AGE_US, telemetry->age_us);
    put_u16(out + UUV_HIL_FRAME_TELEMETRY_FRAMES, telemetry->frames);
    put_u16(out + UUV_HIL_FRAME_TELEMETRY_ERRORS, telemetry->errors);
    put_u16(out + UUV_HIL_FRAME_TELEMETRY_WATCHDOG_TRIPS, telemetry->watchdog_trips);
    for (uint8_t i = 0; i < telemetry->channels; i++)
        put_u16(out + UUV_HIL_FRAME_TELEMETRY_PWM_US + 2u * i, telemetry->pwm_us[i]);
    put_u16(out + size - UUV_HIL_FRAME_CRC_SIZE, checksum(out, size));
    return size;
}
