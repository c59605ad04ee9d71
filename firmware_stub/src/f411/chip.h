/* STM32F411: 84 MHz, without CAN. At 84 MHz it needs no other core voltage than after a reset. Source: ST RM0383,
 * DS10314. */
#ifndef UUV_HIL_CHIP_H
#define UUV_HIL_CHIP_H

#include "family.h"
#include "nucleo64.h"

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

#endif
