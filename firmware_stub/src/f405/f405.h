/* The firmware on an STM32F405, at register level. The core in ../ does not depend on it.
 *
 *   USART1   PA9 (TX), PA10 (RX), 115200 bit/s 8N1: the host. In QEMU the first -serial
 *   TIM3     PC6 to PC9: thrusters 1 to 4; compare registers at 0x40000434, 38, 3C, 40, in microseconds
 *   TIM4     PB6 to PB9: thrusters 5 to 8; compare registers at 0x40000834, 38, 3C, 40
 *   CAN1     PA11 (RX), PA12 (TX), 500 kbit/s: the host, in the protocol of VESCs
 *   SysTick  1 kHz, the clock of the program
 *   crystal  8 MHz, or the value of --crystal of firmware_stub/build.py; without one the chip's own oscillator
 *   IWDG     100 ms, reloaded by the main loop alone
 *
 *   0x08000000  this program, at most 16 KiB (flash sector 0)
 *   0x08004000  Parameters (flash sector 1); where there are none, the defaults of parameters.c hold
 *   0x20000000  RAM, stack from 0x20020000 down
 */
#ifndef UUV_HIL_F405_H
#define UUV_HIL_F405_H

#include "uuv_hil_stm32.h"

#define F405_CHANNELS 8u
#define CORE_HZ 168000000u
#define APB1_TIMER_HZ 84000000u
#define APB2_HZ 84000000u

/* What a flash tool, or an emulator, may write to 0x08004000: five little-endian words. */
typedef struct {
    uint32_t magic; /* PARAMETERS_MAGIC */
    uint32_t channels;
    uint32_t watchdog_ms;
    uint32_t pwm_hz;
    uint32_t baud;
} Parameters;

#define PARAMETERS_MAGIC 0x50565555u /* "UUVP" */

Parameters parameters_read(void); /* each one checked; the default where it is out of range */

void clock_start(void);      /* core at 168 MHz, peripherals on, SysTick counting */
uint64_t clock_now_us(void); /* since clock_start */

void pwm_start(uint32_t pwm_hz); /* all outputs 1500 us */
void pwm_set(const uint16_t *pulse_us, uint8_t channels);

void uart_start(uint32_t baud);
size_t uart_read(uint8_t *out, size_t most); /* the received bytes; unread ones are lost when the buffer is full */
bool uart_idle(void);                        /* whether there is nothing to read */
void uart_write(const uint8_t *data, size_t size);

void can_start(void);
bool can_idle(void);
bool can_read(UuvHilCanFrame *frame); /* whether there was one */
void can_write(const UuvHilCanFrame *frame);

int main(void);
void Reset_Handler(void);
void Fault_Handler(void);
void SysTick_Handler(void);
void USART1_Handler(void);
void CAN1_TX_Handler(void);
void CAN1_RX0_Handler(void);

static inline void interrupts_off(void)
{
    __asm__ volatile("cpsid i" ::: "memory");
}

static inline void interrupts_on(void)
{
    __asm__ volatile("cpsie i" ::: "memory");
}

/* Sleeps until an interrupt is pending, even while they are off. */
static inline void wait_for_interrupt(void)
{
    __asm__ volatile("dsb\n\twfi" ::: "memory");
}

#endif
