/* Start before main: vector table, memory, and the two functions that a compiler may call by itself. */

#include <stddef.h>
#include <stdint.h>

#include "stm32.h"

extern uint32_t stack_top, data_image, data_start, data_end, bss_start, bss_end;

void *memcpy(void *restrict to, const void *restrict from, size_t size)
{
    uint8_t *out = to;
    const uint8_t *in = from;
    for (size_t i = 0; i < size; i++)
        out[i] = in[i];
    return to;
}

void *memset(void *to, int value, size_t size)
{
    uint8_t *out = to;
    for (size_t i = 0; i < size; i++)
        out[i] = (uint8_t)value;
    return to;
}

void Reset_Handler(void)
{
    const uint32_t *from = &data_image;
    for (uint32_t *to = &data_start; to < &data_end; to++)
        *to = *from++;
    for (uint32_t *to = &bss_start; to < &bss_end; to++)
        *to = 0;
    main();
    Fault_Handler();
}

typedef void (*Handler)(void);

/* Entries 0 to 15 are the core's; 16 + n is interrupt n of the chip. */
__attribute__((section(".vectors"), used)) static const Handler vectors[16 + INTERRUPTS] = {
    (Handler)(uintptr_t)&stack_top,
    Reset_Handler,
    [2 ... 14] = Fault_Handler,
    [15] = SysTick_Handler,
    [16 ... 16 + CAN_TX_INTERRUPT - 1] = Fault_Handler,
    [16 + CAN_TX_INTERRUPT] = CAN_TX_Handler,
    [16 + CAN_RX0_INTERRUPT] = CAN_RX0_Handler,
    [16 + CAN_RX0_INTERRUPT + 1 ... 16 + UART_INTERRUPT - 1] = Fault_Handler,
    [16 + UART_INTERRUPT] = UART_Handler,
    [16 + UART_INTERRUPT + 1 ... 16 + INTERRUPTS - 1] = Fault_Handler,
};
