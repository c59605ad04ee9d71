/* Clocks of the F1: 64 MHz from the crystal or, if it does not start, from the STM32's own oscillator. That cannot
 * reach more, and the frequency must not depend on the crystal: pulses and bit rates follow from it. */

#include "stm32.h"

#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define FROM_CRYSTAL BIT(16)
#define CRYSTAL_HALVED BIT(17)
#define PLL_TIMES(n) (((n)-2u) << 18)
#define PATIENCE 100000u /* polls; several milliseconds at 8 MHz */

_Static_assert(HSE_MHZ == 8u || HSE_MHZ == 16u, "from this crystal the PLL does not make 64 MHz");

static bool comes(volatile uint32_t *where, uint32_t bits, uint32_t value)
{
    for (uint32_t i = 0; i < PATIENCE; i++)
        if ((*where & bits) == value)
            return true;
    return false;
}

/* PLL: half the crystal, or half of the own 8 MHz, x 16 (or 8) = 64 MHz. */
void rcc_speed_up(void)
{
    RCC_CR |= RCC_CR_HSEON;
    bool crystal = comes(&RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY);
    uint32_t pll = crystal ? FROM_CRYSTAL | CRYSTAL_HALVED | PLL_TIMES(128u / HSE_MHZ) : PLL_TIMES(16u);
    RCC_CFGR = pll | BUS_DIVIDERS;
    RCC_CR |= RCC_CR_PLLON;
    FLASH_ACR = BIT(4) | FLASH_WAITS; /* prefetch, wait states */
    if (comes(&RCC_CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY))
        RCC_CFGR |= 2u;
    comes(&RCC_CFGR, 3u << 2, 2u << 2);
}

void rcc_peripherals_on(void)
{
    RCC_APB2ENR |= BIT(2) | BIT(3); /* GPIO A, B */
    RCC_APB1ENR |= BIT(1) | BIT(2); /* TIM3, TIM4 */
    UART_CLOCK |= UART_CLOCK_ON;
}

bool rcc_can_on(void)
{
    RCC_APB1ENR |= BIT(25);
    return RCC_APB1ENR & BIT(25);
}
