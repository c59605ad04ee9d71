/* Outputs and serial port of an STM32F4 with 64 pins on a Nucleo board: its USB socket is USART2. */
#ifndef UUV_HIL_NUCLEO64_H
#define UUV_HIL_NUCLEO64_H

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
