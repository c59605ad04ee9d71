/* Time since the start, counted by the core's SysTick timer. */

#include "stm32.h"

#define HSI_READY BIT(1) /* of RCC_CR */

static volatile uint64_t uptime_ms;

void clock_start(void)
{
    /* After a reset the internal oscillator runs. Otherwise this is an emulator without an RCC. */
    if (RCC_CR & HSI_READY)
        rcc_speed_up();
    rcc_peripherals_on();
    SYST_RVR = CORE_HZ / 1000u - 1u;
    SYST_CVR = 0;
    SYST_CSR = 7; /* the core's clock, interrupt, on */
}

void SysTick_Handler(void)
{
    uptime_ms++;
}

uint64_t clock_now_us(void)
{
    uint64_t ms;
    uint32_t left;
    do {
        ms = uptime_ms;
        left = SYST_CVR;
    } while (ms != uptime_ms);
    return ms * 1000u + (CORE_HZ / 1000u - 1u - left) / (CORE_HZ / 1000000u);
}
