/* Eight pulses on TIM3 and TIM4, in microseconds. */

#include "stm32.h"

static const uint32_t timers[] = {TIM3, TIM4};

static void start_timer(uint32_t timer, uint32_t pwm_hz)
{
    TIM_PSC(timer) = TIMER_HZ / 1000000u - 1u; /* counts microseconds */
    TIM_ARR(timer) = 1000000u / pwm_hz - 1u;
    TIM_CCMR1(timer) = 0x6868; /* PWM mode 1; a new width waits for the next period, so that no pulse is cut */
    TIM_CCMR2(timer) = 0x6868;
    for (uint32_t i = 0; i < 4; i++)
        TIM_CCR(timer, i) = 1500;
    TIM_EGR(timer) = 1;
    TIM_CCER(timer) = 0x1111;
    TIM_CR1(timer) = BIT(7) | BIT(0);
}

/* Port and number of a pin. */
typedef struct {
    uint32_t port, pin;
} Pin;

static const Pin pins[OUTPUTS] = {OUTPUT_PINS};

void pwm_start(uint32_t pwm_hz)
{
    start_timer(TIM3, pwm_hz);
    start_timer(TIM4, pwm_hz);
    for (uint32_t i = 0; i < OUTPUTS; i++)
        pin_drive(pins[i].port, pins[i].pin, FUNCTION_TIMERS);
}

void pwm_set(const uint16_t *pulse_us, uint8_t channels)
{
    for (uint32_t i = 0; i < channels; i++)
        TIM_CCR(timers[i / 4], i % 4) = pulse_us[i];
}
