/* Registers of clocks and pins of the family F1. Source: ST RM0008. */
#ifndef UUV_HIL_FAMILY_H
#define UUV_HIL_FAMILY_H

#include "registers.h"

/* Reset and clock control */
#define RCC_CR REGISTER(0x40021000)
#define RCC_CFGR REGISTER(0x40021004)
#define RCC_APB2ENR REGISTER(0x40021018)
#define RCC_APB1ENR REGISTER(0x4002101C)
#define FLASH_ACR REGISTER(0x40022000)

/* Serial ports */
#define USART1 0x40013800u

/* Pins */
#define GPIOA 0x40010800u
#define GPIOB 0x40010C00u
#define GPIO_CR(port, pin) REGISTER((port) + 4 * ((pin) / 8))
#define GPIO_BSRR(port) REGISTER((port) + 0x10)

#endif
