/* Device end of hil/links/vesc/link.py: acts as all VESC motor controllers on CAN at once. */

#include "uuv_hil_stm32.h"

/* github.com/vedderb/bldc, documentation/comm_can.md: an identifier is command << 8 | controller */
enum { SET_DUTY = 0, SET_CURRENT = 1, STATUS = 9, SET_CURRENT_REL = 10 };

#define FIRST_CONTROLLER 1
#define ARGUMENT_SIZE 4
#define FULL_FRACTION 100000 /* of SET_DUTY and SET_CURRENT_REL */
#define FULL_STATUS_DUTY 1000
#define SPAN_US 400          /* from neutral to full output */
#define FULL_ERPM 24500      /* a T200 on 16 V: 3500 rev/min, 7 pole pairs; assumed, not measured */
#define TIMEOUT_US 500000u   /* after which a VESC releases the motor */

static int32_t get_i32(const uint8_t *from)
{
    uint32_t value = (uint32_t)from[0] << 24 | (uint32_t)from[1] << 16 | (uint32_t)from[2] << 8 | from[3];
    return (int32_t)value;
}

static void put_i16(uint8_t *to, int32_t value)
{
    to[0] = (uint8_t)((uint32_t)value >> 8);
    to[1] = (uint8_t)value;
}

static void put_i32(uint8_t *to, int32_t value)
{
    put_i16(to, (int32_t)((uint32_t)value >> 16));
    put_i16(to + 2, value);
}

/* Return the pulse of a fraction in 1/100000, to the nearest microsecond. */
static uint16_t fraction_to_pulse(int32_t fraction)
{
    int32_t clamped = fraction > FULL_FRACTION ? FULL_FRACTION : fraction < -FULL_FRACTION ? -FULL_FRACTION : fraction;
    int32_t half = FULL_FRACTION / SPAN_US / 2;
    int32_t offset_us = (clamped + (clamped < 0 ? -half : half)) / (FULL_FRACTION / SPAN_US);
    return (uint16_t)((int32_t)UUV_HIL_PWM_NEUTRAL_US + offset_us);
}

/* Get the pulse that a frame commands; returns whether the command is supported. A released motor is no pulse. */
static bool read_pulse(const UuvHilCanFrame *frame, uint16_t *pulse_us)
{
    uint32_t command = frame->id >> 8;
    if (frame->size < ARGUMENT_SIZE)
        return false;
    int32_t argument = get_i32(frame->data);
    if (command == SET_CURRENT && argument == 0) {
        *pulse_us = UUV_HIL_NO_PULSE_US;
        return true;
    }
    if (command != SET_DUTY && command != SET_CURRENT_REL)
        return false;
    *pulse_us = fraction_to_pulse(argument);
    return true;
}

/* Make one command from the received ones. Motors without a command keep their output as long as a VESC would. */
static void assemble_command(UuvHilVesc *vesc, uint64_t now_us, UuvHilCommand *command)
{
    *command = (UuvHilCommand){.channels = vesc->channels};
    for (uint8_t i = 0; i < vesc->channels; i++) {
        UuvHilVescMotor *motor = &vesc->motors[i];
        if (motor->is_pending)
            motor->output_us = motor->pending_us;
        else if (now_us - motor->received_us > TIMEOUT_US)
            motor->output_us = UUV_HIL_NO_PULSE_US;
        motor->is_pending = false;
        command->pwm_us[i] = motor->output_us;
        if (motor->output_us != UUV_HIL_NO_PULSE_US)
            command->armed = true;
    }
    vesc->pending_count = 0;
}

void uuv_hil_vesc_start(UuvHilVesc *vesc, uint8_t channels)
{
    *vesc = (UuvHilVesc){.channels = channels};
}

UuvHilReceived uuv_hil_vesc_receive(UuvHilVesc *vesc, const UuvHilCanFrame *frame, uint64_t now_us,
                                    UuvHilCommand *command)
{
    uint32_t controller = frame->id & 0xFFu;
    uint16_t pulse_us;
    if (controller < FIRST_CONTROLLER || controller >= FIRST_CONTROLLER + (uint32_t)vesc->channels)
        return UUV_HIL_NOTHING;
    if (!read_pulse(frame, &pulse_us)) {
        vesc->malformed++;
        return UUV_HIL_NOTHING;
    }
    UuvHilVescMotor *motor = &vesc->motors[controller - FIRST_CONTROLLER];
    bool is_repeated = motor->is_pending;
    if (is_repeated)
        assemble_command(vesc, now_us, command);
    *motor = (UuvHilVescMotor){
        .output_us = motor->output_us,
        .pending_us = pulse_us,
        .is_pending = true,
        .received_us = now_us,
    };
    vesc->pending_count++;
    if (vesc->pending_count == vesc->channels)
        assemble_command(vesc, now_us, command);
    else if (!is_repeated)
        return UUV_HIL_VALID;
    return UUV_HIL_COMMAND;
}

UuvHilCanFrame uuv_hil_vesc_status(uint8_t thruster, uint16_t pulse_us)
{
    int32_t offset_us = pulse_us == UUV_HIL_NO_PULSE_US ? 0 : pulse_us - (int32_t)UUV_HIL_PWM_NEUTRAL_US;
    UuvHilCanFrame frame = {.id = STATUS << 8 | (FIRST_CONTROLLER + (uint32_t)thruster), .size = 8};
    put_i32(frame.data, offset_us * FULL_ERPM / SPAN_US);
    put_i16(frame.data + 4, 0); /* current: not measured */
    put_i16(frame.data + 6, offset_us * FULL_STATUS_DUTY / SPAN_US);
    return frame;
}
