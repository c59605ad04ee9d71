/* Device end of a MAVLink thruster link: a part of hil/links/mavlink/device.py. */

#define MAVLINK_NO_CONVERSION_HELPERS
#define MAVLINK_NO_SIGN_PACKET
#define MAVLINK_NO_SIGNATURE_CHECK
#include <uuv_hil/mavlink.h>

#include "uuv_hil_stm32.h"

#define SYSTEM 1
#define COMPONENT 1
#define PORT 0 /* the set of outputs on this link; others belong to other boards */
#define HEARTBEAT_PERIOD_US 1000000u
#define HEADER_SIZE 10u
#define CRC_SIZE 2u
#define SIGNED 0x01u
#define SIGNATURE_SIZE 13u
#define MAX_SENT_SIZE (HEADER_SIZE + MAVLINK_MSG_ID_SYS_STATUS_LEN + CRC_SIZE)
#define NOT_MEASURED_U16 0xFFFFu
#define IGNORED 0xFFFFu
#define RELEASED 0xFFFEu /* of channels 9 to 18; of the first eight it is 0 */

/* ---- finding packets ---- */

static uint32_t message_id(const uint8_t *packet)
{
    return packet[7] | (uint32_t)packet[8] << 8 | (uint32_t)packet[9] << 16;
}

static size_t packet_size(const uint8_t *bytes, size_t available)
{
    if (available < 3)
        return 3;
    if ((bytes[2] & ~SIGNED) != 0)
        return 0;
    if (available < HEADER_SIZE)
        return HEADER_SIZE;
    if (mavlink_get_msg_entry(message_id(bytes)) == NULL)
        return 0; /* its checksum depends on an unknown layout */
    return HEADER_SIZE + bytes[1] + CRC_SIZE + ((bytes[2] & SIGNED) ? SIGNATURE_SIZE : 0u);
}

static bool is_valid(const uint8_t *packet, size_t size)
{
    (void)size; /* a signature lies behind the checksum */
    size_t end = HEADER_SIZE + packet[1];
    uint16_t crc = crc_calculate(packet + 1, (uint16_t)(end - 1));
    crc_accumulate(mavlink_get_msg_entry(message_id(packet))->crc_extra, &crc);
    return crc == (packet[end] | packet[end + 1] << 8);
}

static const UuvHilFormat mavlink_format = {packet_size, is_valid, MAVLINK_STX};

/* Return whether a packet with this target is for this component. */
static bool is_for_us(uint8_t system, uint8_t component)
{
    return (system == 0 || system == SYSTEM) && (component == 0 || component == COMPONENT);
}

/* ---- sent messages ---- */

static void send_message(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, const mavlink_message_t *message)
{
    uint8_t bytes[MAX_SENT_SIZE];
    mavlink->packets_sent++;
    platform->uart_write(platform->context, bytes, mavlink_msg_to_send_buffer(bytes, message));
}

static mavlink_status_t status(const UuvHilMavlink *mavlink)
{
    return (mavlink_status_t){.current_tx_seq = mavlink->packets_sent};
}

static void send_heartbeat(UuvHilMavlink *mavlink, const UuvHilPlatform *platform)
{
    const UuvHilTelemetry *reported = &mavlink->reported;
    mavlink_status_t link_status = status(mavlink);
    mavlink_message_t message;
    uint8_t state = reported->timed_out ? MAV_STATE_CRITICAL : reported->armed ? MAV_STATE_ACTIVE : MAV_STATE_STANDBY;
    const mavlink_heartbeat_t heartbeat = {
        .type = MAV_TYPE_SUBMARINE,
        .autopilot = MAV_AUTOPILOT_GENERIC,
        .base_mode = reported->armed ? MAV_MODE_FLAG_SAFETY_ARMED : 0,
        .system_status = state,
    };
    mavlink_msg_heartbeat_encode_status(SYSTEM, COMPONENT, &link_status, &message, &heartbeat);
    send_message(mavlink, platform, &message);
}

static void send_sys_status(UuvHilMavlink *mavlink, const UuvHilPlatform *platform)
{
    const UuvHilTelemetry *reported = &mavlink->reported;
    mavlink_status_t link_status = status(mavlink);
    mavlink_message_t message;
    const mavlink_sys_status_t sys_status = {
        .onboard_control_sensors_present = MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS,
        .onboard_control_sensors_enabled = reported->armed ? MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS : 0,
        .onboard_control_sensors_health = reported->timed_out ? 0 : MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS,
        .voltage_battery = NOT_MEASURED_U16,
        .current_battery = -1,
        .battery_remaining = -1,
        .errors_comm = reported->errors,
        .errors_count1 = reported->watchdog_trips,
        .errors_count2 = reported->frames,
    };
    mavlink_msg_sys_status_encode_status(SYSTEM, COMPONENT, &link_status, &message, &sys_status);
    send_message(mavlink, platform, &message);
}

static void send_state(UuvHilMavlink *mavlink, const UuvHilPlatform *platform)
{
    send_heartbeat(mavlink, platform);
    send_sys_status(mavlink, platform);
}

static void send_outputs(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, uint64_t now_us)
{
    const uint16_t *pwm_us = mavlink->reported.pwm_us; /* those beyond its channels are 0 */
    mavlink_status_t link_status = status(mavlink);
    mavlink_message_t message;
    const mavlink_servo_output_raw_t outputs = {
        .time_usec = (uint32_t)now_us,
        .port = PORT,
        .servo1_raw = pwm_us[0], .servo2_raw = pwm_us[1], .servo3_raw = pwm_us[2], .servo4_raw = pwm_us[3],
        .servo5_raw = pwm_us[4], .servo6_raw = pwm_us[5], .servo7_raw = pwm_us[6], .servo8_raw = pwm_us[7],
        .servo9_raw = pwm_us[8], .servo10_raw = pwm_us[9], .servo11_raw = pwm_us[10], .servo12_raw = pwm_us[11],
        .servo13_raw = pwm_us[12], .servo14_raw = pwm_us[13], .servo15_raw = pwm_us[14], .servo16_raw = pwm_us[15],
    };
    mavlink_msg_servo_output_raw_encode_status(SYSTEM, COMPONENT, &link_status, &message, &outputs);
    send_message(mavlink, platform, &message);
}

static void send_acknowledgement(UuvHilMavlink *mavlink, const UuvHilPlatform *platform,
                                 const mavlink_message_t *packet, uint16_t command, uint8_t result)
{
    mavlink_status_t link_status = status(mavlink);
    mavlink_message_t message;
    const mavlink_command_ack_t acknowledgement = {
        .command = command,
        .result = result,
        .target_system = packet->sysid,
        .target_component = packet->compid,
    };
    mavlink_msg_command_ack_encode_status(SYSTEM, COMPONENT, &link_status, &message, &acknowledgement);
    send_message(mavlink, platform, &message);
}

static void answer_timesync(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, const mavlink_message_t *packet,
                            uint64_t now_us)
{
    mavlink_timesync_t requested;
    mavlink_msg_timesync_decode(packet, &requested);
    if (requested.tc1 != 0)
        return; /* an answer */
    mavlink_status_t link_status = status(mavlink);
    mavlink_message_t message;
    const mavlink_timesync_t answer = {.tc1 = (int64_t)(now_us * 1000u), .ts1 = requested.ts1};
    mavlink_msg_timesync_encode_status(SYSTEM, COMPONENT, &link_status, &message, &answer);
    send_message(mavlink, platform, &message);
}

/* ---- commands: each function sets mavlink->command for the board, and returns whether it did ---- */

/* Set the command's sequence number: advanced as the packet's is, or set back if the packet was overtaken. */
static void set_sequence(UuvHilMavlink *mavlink, const mavlink_message_t *packet)
{
    int32_t commander = packet->sysid << 8 | packet->compid;
    int8_t step = commander == mavlink->commander ? (int8_t)(uint8_t)(packet->seq - mavlink->number) : 1;
    mavlink->command.sequence = (uint16_t)(mavlink->command.sequence + step);
    mavlink->number = packet->seq;
    mavlink->commander = commander;
}

static bool set_command(UuvHilMavlink *mavlink, const uint16_t *pwm_us, const mavlink_message_t *packet)
{
    UuvHilCommand *command = &mavlink->command;
    for (uint8_t i = 0; i < command->channels; i++)
        command->pwm_us[i] = command->armed ? pwm_us[i] : UUV_HIL_PWM_NEUTRAL_US;
    set_sequence(mavlink, packet);
    return true;
}

static bool handle_servo_output_raw(UuvHilMavlink *mavlink, const mavlink_message_t *packet)
{
    mavlink_servo_output_raw_t outputs;
    mavlink_msg_servo_output_raw_decode(packet, &outputs);
    if (packet->sysid != SYSTEM || outputs.port != PORT)
        return false;
    const uint16_t pwm_us[UUV_HIL_MAX_CHANNELS] = {
        outputs.servo1_raw, outputs.servo2_raw, outputs.servo3_raw, outputs.servo4_raw,
        outputs.servo5_raw, outputs.servo6_raw, outputs.servo7_raw, outputs.servo8_raw,
        outputs.servo9_raw, outputs.servo10_raw, outputs.servo11_raw, outputs.servo12_raw,
        outputs.servo13_raw, outputs.servo14_raw, outputs.servo15_raw, outputs.servo16_raw,
    };
    return set_command(mavlink, pwm_us, packet);
}

/* Return the pulse of a channel of RC_CHANNELS_OVERRIDE; `current_us` where the channel is ignored. */
static uint16_t override_pulse(uint8_t channel, uint16_t width_us, uint16_t current_us)
{
    bool is_first_eight = channel < 8;
    if (width_us == IGNORED || (width_us == 0 && !is_first_eight))
        return current_us;
    bool is_released = is_first_eight ? width_us == 0 : width_us == RELEASED;
    return is_released ? UUV_HIL_PWM_NEUTRAL_US : width_us;
}

static bool handle_rc_channels_override(UuvHilMavlink *mavlink, const mavlink_message_t *packet)
{
    mavlink_rc_channels_override_t rc;
    mavlink_msg_rc_channels_override_decode(packet, &rc);
    if (!is_for_us(rc.target_system, rc.target_component))
        return false;
    const uint16_t requested[UUV_HIL_MAX_CHANNELS] = {
        rc.chan1_raw, rc.chan2_raw, rc.chan3_raw, rc.chan4_raw, rc.chan5_raw, rc.chan6_raw, rc.chan7_raw, rc.chan8_raw,
        rc.chan9_raw, rc.chan10_raw, rc.chan11_raw, rc.chan12_raw, rc.chan13_raw, rc.chan14_raw, rc.chan15_raw,
        rc.chan16_raw,
    };
    uint16_t pwm_us[UUV_HIL_MAX_CHANNELS];
    for (uint8_t i = 0; i < UUV_HIL_MAX_CHANNELS; i++)
        pwm_us[i] = override_pulse(i, requested[i], mavlink->command.pwm_us[i]);
    return set_command(mavlink, pwm_us, packet);
}

/* Arming does not change the pulses. A command without a change of the armed state has no effect. */
static bool handle_arm_disarm(UuvHilMavlink *mavlink, const mavlink_message_t *packet, float arm, uint8_t *result)
{
    if (arm != 0.0f && arm != 1.0f) {
        *result = MAV_RESULT_DENIED;
        return false;
    }
    *result = MAV_RESULT_ACCEPTED;
    bool armed = arm == 1.0f;
    if (armed == mavlink->command.armed)
        return false;
    mavlink->command.armed = armed;
    return set_command(mavlink, mavlink->command.pwm_us, packet);
}

static bool is_channel(float instance, uint8_t channels)
{
    return instance >= 1.0f && instance <= (float)channels && instance == (float)(uint8_t)instance;
}

static bool is_pulse(float width_us)
{
    return (width_us >= UUV_HIL_PWM_MIN_US && width_us <= UUV_HIL_PWM_MAX_US) || width_us == UUV_HIL_NO_PULSE_US;
}

/* Round to the nearest microsecond; a half goes to the even one. */
static uint16_t round_pulse(float width_us)
{
    uint16_t whole = (uint16_t)width_us;
    float rest = width_us - (float)whole;
    bool is_up = rest > 0.5f || (rest == 0.5f && whole % 2 == 1);
    return is_up ? (uint16_t)(whole + 1) : whole;
}

static bool handle_set_servo(UuvHilMavlink *mavlink, const mavlink_message_t *packet, float instance, float width_us,
                             uint8_t *result)
{
    if (!is_channel(instance, mavlink->command.channels) || !is_pulse(width_us)) {
        *result = MAV_RESULT_DENIED;
        return false;
    }
    if (!mavlink->command.armed) {
        *result = MAV_RESULT_TEMPORARILY_REJECTED;
        return false;
    }
    *result = MAV_RESULT_ACCEPTED;
    mavlink->command.pwm_us[(uint8_t)instance - 1] = round_pulse(width_us);
    set_sequence(mavlink, packet);
    return true;
}

static bool handle_command_long(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, const mavlink_message_t *packet)
{
    mavlink_command_long_t requested;
    mavlink_msg_command_long_decode(packet, &requested);
    if (!is_for_us(requested.target_system, requested.target_component))
        return false;
    uint8_t result = MAV_RESULT_UNSUPPORTED;
    bool is_changed = false;
    if (requested.command == MAV_CMD_COMPONENT_ARM_DISARM)
        is_changed = handle_arm_disarm(mavlink, packet, requested.param1, &result);
    else if (requested.command == MAV_CMD_DO_SET_SERVO)
        is_changed = handle_set_servo(mavlink, packet, requested.param1, requested.param2, &result);
    send_acknowledgement(mavlink, platform, packet, requested.command, result);
    return is_changed;
}

static bool handle_packet(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, const mavlink_message_t *packet,
                          uint64_t now_us)
{
    switch (packet->msgid) {
    case MAVLINK_MSG_ID_SERVO_OUTPUT_RAW:
        return handle_servo_output_raw(mavlink, packet);
    case MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE:
        return handle_rc_channels_override(mavlink, packet);
    case MAVLINK_MSG_ID_COMMAND_LONG:
        return handle_command_long(mavlink, platform, packet);
    case MAVLINK_MSG_ID_TIMESYNC:
        answer_timesync(mavlink, platform, packet, now_us);
        return false;
    default:
        return false;
    }
}

/* Copy the fields that the decoders read; to clear the whole record would take longer than to decode it. */
static void unpack_header_and_payload(const uint8_t *packet, mavlink_message_t *message)
{
    message->len = packet[1];
    message->seq = packet[4];
    message->sysid = packet[5];
    message->compid = packet[6];
    message->msgid = message_id(packet) & 0xFFFFFFu;
    memcpy(_MAV_PAYLOAD_NON_CONST(message), packet + HEADER_SIZE, message->len);
}

/* ---- public functions ---- */

void uuv_hil_mavlink_start(UuvHilMavlink *mavlink, uint8_t channels)
{
    *mavlink = (UuvHilMavlink){.commander = -1, .command = {.channels = channels}};
    for (uint8_t i = 0; i < channels; i++)
        mavlink->command.pwm_us[i] = UUV_HIL_PWM_NEUTRAL_US;
}

UuvHilReceived uuv_hil_mavlink_feed(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, uint8_t byte,
                                    uint64_t now_us, UuvHilCommand *command)
{
    const uint8_t *packet = uuv_hil_stream_feed(&mavlink->packets, &mavlink_format, byte);
    if (packet == NULL)
        return UUV_HIL_NOTHING;
    mavlink_message_t message;
    unpack_header_and_payload(packet, &message);
    if (message.sysid == SYSTEM && message.compid == COMPONENT)
        return UUV_HIL_VALID; /* our own echo */
    if (!handle_packet(mavlink, platform, &message, now_us))
        return UUV_HIL_VALID;
    *command = mavlink->command;
    return UUV_HIL_COMMAND;
}

void uuv_hil_mavlink_report(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, const UuvHilTelemetry *telemetry,
                            uint64_t now_us)
{
    const UuvHilTelemetry reported = mavlink->reported;
    mavlink->reported = *telemetry;
    mavlink->command.armed = telemetry->armed;
    for (uint8_t i = 0; i < telemetry->channels; i++)
        mavlink->command.pwm_us[i] = telemetry->pwm_us[i];
    if (reported.armed != telemetry->armed || reported.timed_out != telemetry->timed_out
        || reported.watchdog_trips != telemetry->watchdog_trips)
        send_state(mavlink, platform);
    send_outputs(mavlink, platform, now_us);
}

void uuv_hil_mavlink_tick(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, uint64_t now_us)
{
    uint64_t due_us = mavlink->heartbeat_due_us;
    if (now_us < due_us)
        return;
    bool fell_behind = now_us >= due_us + HEARTBEAT_PERIOD_US;
    mavlink->heartbeat_due_us = (fell_behind ? now_us : due_us) + HEARTBEAT_PERIOD_US;
    send_state(mavlink, platform);
}
