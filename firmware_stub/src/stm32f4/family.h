/* Registers of clocks and pins of the family F4. Source: ST RM0090 (F405), RM0383 (F411), RM0390 (F446). */
#ifndef UUV_HIL_FAMILY_H
#define UUV_HIL_FAMILY_H

#include "registers.h"

/* Reset and clock control */
#define RCC_CR REGISTER(0x40023800)
#define RCC_PLLCFGR REGISTER(0x40023804)
#define RCC_CFGR REGISTER(0x40023808)
#define RCC_AHB1ENR REGISTER(0x40023830)
#define RCC_APB1ENR REGISTER(0x40023840)
#define RCC_APB2ENR REGISTER(0x40023844)
#define FLASH_ACR REGISTER(0x40023C00)

/* Serial ports */
#define USART1 0x40011000u
#define USART2 0x40004400u

/* Pins */
#define GPIOA 0x40020000u
#define GPIOB 0x40020400u
#define GPIOC 0x40020800u
#define GPIO_MODER(port) REGISTER((port) + 0x00)
#define GPIO_PUPDR(port) REGISTER((port) + 0x0C)
#define GPIO_AFR(port, pin) REGISTER((port) + 0x20 + 4 * ((pin) / 8))

#endif
