/* Registers that this firmware uses and that are the same in the families F1 and F4. Source: ST RM0008 (F103), RM0090 (F405),
 * RM0383 (F411), RM0390 (F446), the register section of each peripheral; the core's own: ARMv7-M Architecture Reference
 * Manual, B3. */
#ifndef UUV_HIL_REGISTERS_H
#define UUV_HIL_REGISTERS_H

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define BIT(n) (1u << (n))

/* Timers 3 and 4 */
#define TIM3 0x40000400u
#define TIM4 0x40000800u
#define TIM_CR1(timer) REGISTER((timer) + 0x00)
#define TIM_EGR(timer) REGISTER((timer) + 0x14)
#define TIM_CCMR1(timer) REGISTER((timer) + 0x18)
#define TIM_CCMR2(timer) REGISTER((timer) + 0x1C)
#define TIM_CCER(timer) REGISTER((timer) + 0x20)
#define TIM_PSC(timer) REGISTER((timer) + 0x28)
#define TIM_ARR(timer) REGISTER((timer) + 0x2C)
#define TIM_CCR(timer, channel) REGISTER((timer) + 0x34 + 4 * (channel))

/* A USART: `port` is its address, of chip.h. */
#define USART_SR(port) REGISTER((port) + 0x00)
#define USART_DR(port) REGISTER((port) + 0x04)
#define USART_BRR(port) REGISTER((port) + 0x08)
#define USART_CR1(port) REGISTER((port) + 0x0C)
#define USART_SR_ORE BIT(3)
#define USART_SR_RXNE BIT(5)
#define USART_SR_TXE BIT(7)
#define USART_CR1_RE BIT(2)
#define USART_CR1_TE BIT(3)
#define USART_CR1_RXNEIE BIT(5)
#define USART_CR1_TXEIE BIT(7)
#define USART_CR1_UE BIT(13)

/* CAN: the only controller, or the first */
#define CAN_MCR REGISTER(0x40006400)
#define CAN_MSR REGISTER(0x40006404)
#define CAN_TSR REGISTER(0x40006408)
#define CAN_RF0R REGISTER(0x4000640C)
#define CAN_IER REGISTER(0x40006414)
#define CAN_BTR REGISTER(0x4000641C)
#define CAN_TIR(mailbox) REGISTER(0x40006580 + 16 * (mailbox))
#define CAN_TDTR(mailbox) REGISTER(0x40006584 + 16 * (mailbox))
#define CAN_TDLR(mailbox) REGISTER(0x40006588 + 16 * (mailbox))
#define CAN_TDHR(mailbox) REGISTER(0x4000658C + 16 * (mailbox))
#define CAN_RI0R REGISTER(0x400065B0)
#define CAN_RDT0R REGISTER(0x400065B4)
#define CAN_RDL0R REGISTER(0x400065B8)
#define CAN_RDH0R REGISTER(0x400065BC)
#define CAN_FMR REGISTER(0x40006600)
#define CAN_FS1R REGISTER(0x4000660C)
#define CAN_FA1R REGISTER(0x4000661C)
#define CAN_FILTER(half) REGISTER(0x40006640 + 4 * (half))
#define CAN_MCR_INRQ BIT(0)
#define CAN_MCR_TXFP BIT(2)
#define CAN_MCR_ABOM BIT(6)
#define CAN_TSR_DONE (BIT(0) | BIT(8) | BIT(16))
#define CAN_TSR_EMPTY(mailbox) BIT(26 + (mailbox))
#define CAN_RF0R_RELEASE BIT(5)
#define CAN_IER_TMEIE BIT(0)
#define CAN_IER_FMPIE0 BIT(1)

/* Alternate functions of pins on an F4; the pins of an F1 have one each */
#define FUNCTION_TIMERS 2u
#define FUNCTION_USARTS 7u
#define FUNCTION_CAN 9u

/* Independent watchdog */
#define IWDG_KR REGISTER(0x40003000)
#define IWDG_PR REGISTER(0x40003004)
#define IWDG_RLR REGISTER(0x40003008)

/* The core's own: SysTick, interrupt controller */
#define SYST_CSR REGISTER(0xE000E010)
#define SYST_RVR REGISTER(0xE000E014)
#define SYST_CVR REGISTER(0xE000E018)
#define NVIC_ISER(interrupt) REGISTER(0xE000E100 + 4 * ((interrupt) / 32))
#define CAN_TX_INTERRUPT 19u
#define CAN_RX0_INTERRUPT 20u

#endif
