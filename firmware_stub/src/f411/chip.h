/* STM32F411: 84 MHz, without CAN. At 84 MHz it needs no other core voltage than after a reset. Source: ST RM0383,
 * DS10314. */
#ifndef UUV_HIL_CHIP_H
#define UUV_HIL_CHIP_H

#include "family.h"

#ifndef HSE_MHZ
#define HSE_MHZ 0u /* none used, but its own oscillator: a Black Pill has 25 MHz, a Nucleo 8 */
#endif
#define HSE_BYPASS 0u
#define CORE_HZ 84000000u
#define APB1_HZ 42000000u
#define APB2_HZ 84000000u
#define TIMER_HZ 84000000u
#define PLL_N 168u
#define FLASH_WAITS 2u
#define BUS_DIVIDERS (4u << 10) /* APB1 by 2 */
#define INTERRUPTS 86u

/* USART2: PA2, PA3 */
#define UART USART2
#define UART_HZ APB1_HZ
#define UART_INTERRUPT 38u
#define UART_CLOCK RCC_APB1ENR
#define UART_CLOCK_ON BIT(17)
#define UART_PORT GPIOA
#define UART_TX_PIN 2u
#define UART_RX_PIN 3u

/* TIM3: PA6, PA7, PB0, PB1; TIM4: PB6 to PB9 */
#define OUTPUT_PINS \
    {GPIOA, 6}, {GPIOA, 7}, {GPIOB, 0}, {GPIOB, 1}, {GPIOB, 6}, {GPIOB, 7}, {GPIOB, 8}, {GPIOB, 9}

#endif
