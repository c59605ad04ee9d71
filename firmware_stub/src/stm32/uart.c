/* The serial port with a ring buffer each way, both served by its interrupt. */

#include "stm32.h"

#define RING_SIZE 512u /* a power of two; at 115200 bit/s 44 ms */

/* The indices only count up; one side writes `head`, the other `tail`. */
typedef struct {
    uint8_t bytes[RING_SIZE];
    volatile uint32_t head;
    volatile uint32_t tail;
} Ring;

static Ring received, to_send;

static uint32_t stored_count(const Ring *ring)
{
    return ring->head - ring->tail;
}

static void put(Ring *ring, uint8_t byte)
{
    if (stored_count(ring) == RING_SIZE)
        return;
    ring->bytes[ring->head % RING_SIZE] = byte;
    ring->head++;
}

static uint8_t get(Ring *ring)
{
    uint8_t byte = ring->bytes[ring->tail % RING_SIZE];
    ring->tail++;
    return byte;
}

/* Send what the port accepts now; its interrupt sends the rest. Emulators accept all at once, without interrupts. */
static void send_stored(void)
{
    while (stored_count(&to_send) > 0 && (USART_SR(UART) & USART_SR_TXE))
        USART_DR(UART) = get(&to_send);
    if (stored_count(&to_send) > 0)
        USART_CR1(UART) |= USART_CR1_TXEIE;
    else
        USART_CR1(UART) &= ~USART_CR1_TXEIE;
}

/* Read all received bytes. An overrun requests the interrupt too, until the data register is read. */
void UART_Handler(void)
{
    uint32_t status;
    while ((status = USART_SR(UART)) & (USART_SR_RXNE | USART_SR_ORE)) {
        uint8_t byte = (uint8_t)USART_DR(UART);
        if (status & USART_SR_RXNE)
            put(&received, byte);
    }
    send_stored();
}

void uart_start(uint32_t baud)
{
    pin_drive(UART_PORT, UART_TX_PIN, FUNCTION_USARTS);
    pin_read(UART_PORT, UART_RX_PIN, FUNCTION_USARTS); /* pulled up, an open line reads as idle */
    USART_BRR(UART) = (UART_HZ + baud / 2) / baud;
    USART_CR1(UART) = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_RXNEIE;
    NVIC_ISER(UART_INTERRUPT) = BIT(UART_INTERRUPT % 32);
}

bool uart_is_empty(void)
{
    return stored_count(&received) == 0;
}

size_t uart_read(uint8_t *out, size_t capacity)
{
    size_t count = 0;
    while (count < capacity && stored_count(&received) > 0)
        out[count++] = get(&received);
    return count;
}

void uart_write(const uint8_t *data, size_t size)
{
    if (RING_SIZE - stored_count(&to_send) < size)
        return;
    for (size_t i = 0; i < size; i++)
        put(&to_send, data[i]);
    interrupts_off();
    send_stored();
    interrupts_on();
}
