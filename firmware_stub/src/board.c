/* Outputs, arming, watchdog and counters: firmware_stub/stub.py in C. */

#include "uuv_hil_stm32.h"

void uuv_hil_board_start(UuvHilBoard *board, uint8_t channels, uint32_t watchdog_us)
{
    *board = (UuvHilBoard){
        .channels = channels,
        .watchdog_us = watchdog_us,
        .applied_us = UUV_HIL_NEVER_DUE_US,
        .watchdog_due_us = UUV_HIL_NEVER_DUE_US,
    };
    uuv_hil_board_disarm(board);
}

void uuv_hil_board_disarm(UuvHilBoard *board)
{
    board->armed = false;
    for (uint8_t i = 0; i < board->channels; i++)
        board->pwm_us[i] = UUV_HIL_PWM_NEUTRAL_US;
}

static bool is_late(const UuvHilBoard *board, uint16_t sequence)
{
    uint16_t behind = (uint16_t)(board->sequence - sequence);
    return board->watchdog_due_us != UUV_HIL_NEVER_DUE_US && behind > 0 && behind <= UUV_HIL_LATE_WINDOW;
}

static uint16_t pulse(uint16_t width_us)
{
    bool in_range = width_us >= UUV_HIL_PWM_MIN_US && width_us <= UUV_HIL_PWM_MAX_US;
    return in_range ? width_us : UUV_HIL_NO_PULSE_US;
}

static void arm(UuvHilBoard *board, const uint16_t *pwm_us)
{
    board->armed = true;
    for (uint8_t i = 0; i < board->channels; i++)
        board->pwm_us[i] = pulse(pwm_us[i]);
}

bool uuv_hil_board_command(UuvHilBoard *board, const UuvHilCommand *command, uint64_t now_us)
{
    if (command->channels != board->channels || is_late(board, command->sequence)) {
        board->refused++;
        return false;
    }
    if (command->armed)
        arm(board, command->pwm_us);
    else
        uuv_hil_board_disarm(board);
    board->timed_out = false;
    board->sequence = command->sequence;
    board->applied_us = now_us;
    board->frames++;
    board->watchdog_due_us = now_us + board->watchdog_us;
    return true;
}

bool uuv_hil_board_tick(UuvHilBoard *board, uint64_t now_us)
{
    if (now_us >= board->watchdog_due_us) {
        uuv_hil_board_disarm(board);
        board->timed_out = true;
        board->watchdog_trips++;
        board->watchdog_due_us = UUV_HIL_NEVER_DUE_US;
        board->telemetry_due_us = now_us;
    }
    return now_us >= board->telemetry_due_us;
}

static uint32_t age_us(const UuvHilBoard *board, uint64_t now_us)
{
    if (board->applied_us == UUV_HIL_NEVER_DUE_US || now_us - board->applied_us > UUV_HIL_NEVER_US)
        return UUV_HIL_NEVER_US;
    return (uint32_t)(now_us - board->applied_us);
}

static void plan_next_report(UuvHilBoard *board, uint64_t now_us)
{
    uint64_t due_us = board->telemetry_due_us;
    bool on_time = now_us >= due_us && now_us - due_us < UUV_HIL_TELEMETRY_PERIOD_US;
    board->telemetry_due_us = (on_time ? due_us : now_us) + UUV_HIL_TELEMETRY_PERIOD_US;
}

UuvHilTelemetry uuv_hil_board_telemetry(UuvHilBoard *board, uint64_t now_us)
{
    plan_next_report(board, now_us);
    UuvHilTelemetry telemetry = {
        .sequence = board->sequence,
        .armed = board->armed,
        .timed_out = board->timed_out,
        .channels = board->channels,
        .age_us = age_us(board, now_us),
        .frames = board->frames,
        .errors = (uint16_t)(board->refused + board->line_errors),
        .watchdog_trips = board->watchdog_trips,
    };
    for (uint8_t i = 0; i < board->channels; i++)
        telemetry.pwm_us[i] = board->pwm_us[i];
    return telemetry;
}

uint64_t uuv_hil_board_deadline_us(const UuvHilBoard *board)
{
    bool watchdog_first = board->watchdog_due_us < board->telemetry_due_us;
    return watchdog_first ? board->watchdog_due_us : board->telemetry_due_us;
}
