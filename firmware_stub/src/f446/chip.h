/* STM32F446: 168 MHz, with CAN. Up to that it needs no over-drive. Source: ST RM0390, DS10693. */
#ifndef UUV_HIL_CHIP_H
#define UUV_HIL_CHIP_H

#include "family.h"
#include "nucleo64.h"

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

#endif
