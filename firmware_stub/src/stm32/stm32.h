/* The firmware on an STM32 of the families F1 and F4, at register level. The core in ../ does not depend on it.
 *
 *   ../stm32/      common to both families: timers, serial port, CAN, watchdog, interrupts, the main loop
 *   ../stm32f1/    ../stm32f4/     clocks and pins of a family
 *   ../f103/       ../f405/ ...    a chip: chip.h (frequencies, pins), chip.ld (memory), chip.toml (wiring, for users)
 *
 *   a serial port, 115200 bit/s 8N1: the host
 *   TIM3, TIM4     thrusters 1 to 4, 5 to 8; compare registers at 0x40000434 and 0x40000834, in microseconds
 *   CAN, where the chip has it, 500 kbit/s: the host, in the protocol of VESCs
 *   SysTick        1 kHz, the clock of the program
 *   IWDG           100 ms, reloaded only by the main loop
 *
 *   0x08000000  this program, at most 16 KiB
 *   0x08004000  Parameters (on the F4 the second sector); without them the defaults of parameters.c apply
 *   0x20000000  RAM, stack from its top down
 */
#ifndef UUV_HIL_STM32_CHIP_H
#define UUV_HIL_STM32_CHIP_H

#include "chip.h" /* which includes family.h */
#include "uuv_hil_stm32.h"

#define OUTPUTS 8u

/* Parameters that a flash tool or an emulator may write to 0x08004000: five little-endian words. */
typedef struct {
    uint32_t magic; /* PARAMETERS_MAGIC */
    uint32_t channels;
    uint32_t watchdog_ms;
    uint32_t pwm_hz;
    uint32_t baud;
} Parameters;

#define PARAMETERS_MAGIC 0x50565555u /* "UUVP" */

Parameters parameters_read(void); /* each is checked; a value out of range is replaced by its default */

void clock_start(void);      /* core at CORE_HZ, peripherals on, SysTick counting */
uint64_t clock_now_us(void); /* since clock_start */

/* Of the family: rcc.c, pins.c. */
void rcc_speed_up(void);       /* core and buses at the frequencies of chip.h */
void rcc_peripherals_on(void); /* clocks of those that chip.h names */
bool rcc_can_on(void);         /* whether the chip has CAN */
/* A pin that its peripheral drives; one that it reads, pulled up. `function` is its alternate function on an F4. */
void pin_drive(uint32_t port, uint32_t pin, uint32_t function);
void pin_read(uint32_t port, uint32_t pin, uint32_t function);

void pwm_start(uint32_t pwm_hz); /* all outputs 1500 us */
void pwm_set(const uint16_t *pulse_us, uint8_t channels);

void uart_start(uint32_t baud);
size_t uart_read(uint8_t *out, size_t capacity); /* the received bytes; unread ones are lost when the buffer is full */
bool uart_is_empty(void);                            /* whether there is nothing to read */
void uart_write(const uint8_t *data, size_t size);

void can_start(void);
bool can_is_empty(void);
bool can_read(UuvHilCanFrame *frame); /* whether there was one */
void can_write(const UuvHilCanFrame *frame);

int main(void);
void Reset_Handler(void);
void Fault_Handler(void);
void SysTick_Handler(void);
void UART_Handler(void);
void CAN_TX_Handler(void);
void CAN_RX0_Handler(void);

static inline void interrupts_off(void)
{
    __asm__ volatile("cpsid i" ::: "memory");
}

static inline void interrupts_on(void)
{
    __asm__ volatile("cpsie i" ::: "memory");
}

/* Sleeps until an interrupt is pending, also while interrupts are masked. */
static inline void wait_for_interrupt(void)
{
    __asm__ volatile("dsb\n\twfi" ::: "memory");
}

#endif
