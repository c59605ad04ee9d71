/* STM32F405: 168 MHz, with CAN. Source: ST RM0090, DS8626. */
#ifndef UUV_HIL_CHIP_H
#define UUV_HIL_CHIP_H

#include "family.h"

#ifndef HSE_MHZ
#define HSE_MHZ 8u /* the crystal of the board: python -m firmware_stub.build --crystal */
#endif
#define HSE_BYPASS 0u
#define CORE_HZ 168000000u
#define APB1_HZ 42000000u
#define APB2_HZ 84000000u
#define TIMER_HZ 84000000u
#define PLL_N 336u
#define FLASH_WAITS 5u
#define BUS_DIVIDERS (4u << 13 | 5u << 10) /* APB2 by 2, APB1 by 4 */
#define INTERRUPTS 82u
#define CAN_BIT_TIMING (1u << 20 | 10u << 16 | 5u) /* 42 MHz / 6 / (1 + 11 + 2), sampled at 86 % */

/* USART1: PA9, PA10 */
#define UART USART1
#define UART_HZ APB2_HZ
#define UART_INTERRUPT 37u
#define UART_CLOCK RCC_APB2ENR
#define UART_CLOCK_ON BIT(4)
#define UART_PORT GPIOA
#define UART_TX_PIN 9u
#define UART_RX_PIN 10u

/* TIM3: PC6 to PC9; TIM4: PB6 to PB9 */
#define OUTPUT_PINS \
    {GPIOC, 6}, {GPIOC, 7}, {GPIOC, 8}, {GPIOC, 9}, {GPIOB, 6}, {GPIOB, 7}, {GPIOB, 8}, {GPIOB, 9}

#endif
