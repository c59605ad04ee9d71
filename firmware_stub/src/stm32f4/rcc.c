/* Clocks of the F4: from the crystal or, if it does not start, from the STM32's own oscillator. */

#include "stm32.h"

#define HSI_MHZ 16u

#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define PATIENCE 100000u /* polls; several milliseconds at 16 MHz */

static bool comes(volatile uint32_t *where, uint32_t bits, uint32_t value)
{
    for (uint32_t i = 0; i < PATIENCE; i++)
        if ((*where & bits) == value)
            return true;
    return false;
}

static bool crystal_swings(void)
{
    if (HSE_MHZ == 0)
        return false;
    RCC_CR |= HSE_BYPASS;
    RCC_CR |= RCC_CR_HSEON;
    return comes(&RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY);
}

/* PLL: 1 MHz x PLL_N / 2. Bits 28 and up are the reset value's: a divider of the F446's that must not be 0. */
void rcc_speed_up(void)
{
    bool crystal = crystal_swings();
    RCC_PLLCFGR = 2u << 28 | 7u << 24 | (crystal ? BIT(22) : 0u) | PLL_N << 6 | (crystal ? HSE_MHZ : HSI_MHZ);
    RCC_CR |= RCC_CR_PLLON;
    FLASH_ACR = BIT(10) | BIT(9) | BIT(8) | FLASH_WAITS; /* caches, prefetch, wait states */
    RCC_CFGR = BUS_DIVIDERS;
    if (comes(&RCC_CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY))
        RCC_CFGR |= 2u;
    comes(&RCC_CFGR, 3u << 2, 2u << 2);
}

void rcc_peripherals_on(void)
{
    RCC_AHB1ENR |= BIT(0) | BIT(1) | BIT(2); /* GPIO A, B, C */
    RCC_APB1ENR |= BIT(1) | BIT(2);          /* TIM3, TIM4 */
    UART_CLOCK |= UART_CLOCK_ON;
}

bool rcc_can_on(void)
{
    RCC_APB1ENR |= BIT(25);
    return RCC_APB1ENR & BIT(25);
}
