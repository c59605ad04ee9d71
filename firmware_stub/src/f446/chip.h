/* STM32F446: 168 MHz, with CAN. Up to that it needs no over-drive. Source: ST RM0390, DS10693. */
#ifndef UUV_HIL_CHIP_H
#define UUV_HIL_CHIP_H

#include "family.h"

#ifndef HSE_MHZ
#define HSE_MHZ 8u /* from the debugger of a Nucleo, as a clock and not as a crystal */
#endif
#define HSE_BYPASS BIT(18)
#define CORE_HZ 168000000u
#define APB1_HZ 42000000u
#define APB2_HZ 84000000u
#define TIMER_HZ 84000000u
#define PLL_N 336u
#define FLASH_WAITS 5u
#define BUS_DIVIDERS (4u << 13 | 5u << 10) /* APB2 by 2, APB1 by 4 */
#define INTERRUPTS 97u
#define CAN_BIT_TIMING (1u << 20 | 10u << 16 | 5u) /* 42 MHz / 6 / (1 + 11 + 2), sampled at 86 % */

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
