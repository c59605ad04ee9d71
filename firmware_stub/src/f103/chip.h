/* STM32F103: 64 MHz, with CAN. Source: ST RM0008, DS5319. */
#ifndef UUV_HIL_CHIP_H
#define UUV_HIL_CHIP_H

#include "family.h"

#ifndef HSE_MHZ
#define HSE_MHZ 8u /* the crystal of the board: python -m firmware_stub.build --crystal */
#endif
#define CORE_HZ 64000000u
#define APB1_HZ 32000000u
#define APB2_HZ 64000000u
#define TIMER_HZ 64000000u
#define FLASH_WAITS 2u
#define BUS_DIVIDERS (4u << 8) /* APB1 by 2 */
#define INTERRUPTS 60u
#define CAN_BIT_TIMING (1u << 20 | 12u << 16 | 3u) /* 32 MHz / 4 / (1 + 13 + 2), sampled at 88 % */

/* USART1: PA9, PA10 */
#define UART USART1
#define UART_HZ APB2_HZ
#define UART_INTERRUPT 37u
#define UART_CLOCK RCC_APB2ENR
#define UART_CLOCK_ON BIT(14)
#define UART_PORT GPIOA
#define UART_TX_PIN 9u
#define UART_RX_PIN 10u

/* TIM3: PA6, PA7, PB0, PB1; TIM4: PB6 to PB9 */
#define OUTPUT_PINS \
    {GPIOA, 6}, {GPIOA, 7}, {GPIOB, 0}, {GPIOB, 1}, {GPIOB, 6}, {GPIOB, 7}, {GPIOB, 8}, {GPIOB, 9}

#endif
