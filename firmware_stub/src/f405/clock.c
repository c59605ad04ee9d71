/* 168 MHz from the crystal or, if that does not swing, from the STM32's own oscillator; and the time. */

#include "f405.h"
#include "registers.h"

#ifndef HSE_MHZ
#define HSE_MHZ 8u /* the crystal of the board: python -m firmware_stub.build --crystal */
#endif
#define HSI_MHZ 16u

#define RCC_CR_HSIRDY BIT(1)
#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define PATIENCE 100000u /* polls; several milliseconds at 16 MHz */

static volatile uint64_t uptime_ms;

static bool comes(volatile uint32_t *where, uint32_t bits, uint32_t value)
{
    for (uint32_t i = 0; i < PATIENCE; i++)
        if ((*where & bits) == value)
            return true;
    return false;
}

/* PLL: 1 MHz x 336 / 2 = 168 MHz. Buses: APB1 42 MHz (its timers 84), APB2 84 MHz. */
static void speed_up(void)
{
    RCC_CR |= RCC_CR_HSEON;
    bool crystal = comes(&RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY);
    RCC_PLLCFGR = 7u << 24 | (crystal ? BIT(22) : 0u) | 336u << 6 | (crystal ? HSE_MHZ : HSI_MHZ);
    RCC_CR |= RCC_CR_PLLON;
    FLASH_ACR = BIT(10) | BIT(9) | BIT(8) | 5u; /* caches, prefetch, 5 wait states: RM0090 table 10 */
    RCC_CFGR = 4u << 13 | 5u << 10;
    if (comes(&RCC_CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY))
        RCC_CFGR |= 2u;
    comes(&RCC_CFGR, 3u << 2, 2u << 2);
}

void clock_start(void)
{
    /* After a reset the internal oscillator runs. Where it does not there is no RCC to set: an emulator. */
    if (RCC_CR & RCC_CR_HSIRDY)
        speed_up();
    RCC_AHB1ENR |= BIT(0) | BIT(1) | BIT(2);  /* GPIO A, B, C */
    RCC_APB1ENR |= BIT(1) | BIT(2) | BIT(25); /* TIM3, TIM4, CAN1 */
    RCC_APB2ENR |= BIT(4);                    /* USART1 */
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
