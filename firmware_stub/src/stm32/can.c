/* CAN at 500 kbit/s, the VESCs' default: extended data frames, with a ring buffer each way. */

#include "stm32.h"

#define RING_SIZE 32u /* a power of two; a report is 8 */
#define MAX_POLLS 10000u /* polls; it takes the time of one frame, but never succeeds without a controller */
#define EXTENDED BIT(2)
#define REMOTE BIT(1)
#define TRANSMIT_REQUEST BIT(0)

typedef struct {
    UuvHilCanFrame frames[RING_SIZE];
    volatile uint32_t head; /* the indices only count up; one side writes `head`, the other `tail` */
    volatile uint32_t tail;
} Ring;

static Ring received, to_send;

static void put(Ring *ring, const UuvHilCanFrame *frame)
{
    if (ring->head - ring->tail == RING_SIZE)
        return;
    ring->frames[ring->head % RING_SIZE] = *frame;
    ring->head++;
}

static bool get(Ring *ring, UuvHilCanFrame *frame)
{
    if (ring->head == ring->tail)
        return false;
    *frame = ring->frames[ring->tail % RING_SIZE];
    ring->tail++;
    return true;
}

static uint32_t get_word(const uint8_t *bytes)
{
    return bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static void put_word(uint8_t *bytes, uint32_t value)
{
    for (uint32_t i = 0; i < 4; i++)
        bytes[i] = (uint8_t)(value >> 8 * i);
}

static void load(uint32_t mailbox, const UuvHilCanFrame *frame)
{
    CAN_TDTR(mailbox) = frame->size;
    CAN_TDLR(mailbox) = get_word(frame->data);
    CAN_TDHR(mailbox) = get_word(frame->data + 4);
    CAN_TIR(mailbox) = frame->id << 3 | EXTENDED | TRANSMIT_REQUEST;
}

/* Fill the empty mailboxes; each one that is sent raises the interrupt again. */
static void send_stored(void)
{
    UuvHilCanFrame frame;
    for (uint32_t mailbox = 0; mailbox < 3; mailbox++)
        if ((CAN_TSR & CAN_TSR_EMPTY(mailbox)) && get(&to_send, &frame))
            load(mailbox, &frame);
}

void CAN_TX_Handler(void)
{
    CAN_TSR = CAN_TSR_DONE;
    send_stored();
}

/* One frame per interrupt, which stays requested while there are more frames. */
void CAN_RX0_Handler(void)
{
    uint32_t id = CAN_RI0R;
    UuvHilCanFrame frame = {.id = id >> 3, .size = (uint8_t)(CAN_RDT0R & 15u)};
    put_word(frame.data, CAN_RDL0R);
    put_word(frame.data + 4, CAN_RDH0R);
    CAN_RF0R = CAN_RF0R_RELEASE;
    if ((id & EXTENDED) && !(id & REMOTE))
        put(&received, &frame);
}

static void accept_all(void)
{
    CAN_FMR |= BIT(0);
    CAN_FS1R = 1;
    CAN_FILTER(0) = 0;
    CAN_FILTER(1) = 0;
    CAN_FA1R = 1;
    CAN_FMR &= ~BIT(0);
}

void can_start(void)
{
    if (!rcc_can_on())
        return; /* a chip of the family without it, or an emulator */
    pin_read(GPIOA, 11, FUNCTION_CAN);
    pin_drive(GPIOA, 12, FUNCTION_CAN);
    CAN_MCR = CAN_MCR_INRQ;
    for (uint32_t i = 0; i < MAX_POLLS && !(CAN_MSR & BIT(0)); i++) {
    }
    CAN_BTR = CAN_BIT_TIMING;
    accept_all();
    CAN_IER = CAN_IER_TMEIE | CAN_IER_FMPIE0;
    CAN_MCR = CAN_MCR_ABOM | CAN_MCR_TXFP; /* recover from bus-off automatically; send first in, first out */
    NVIC_ISER(CAN_TX_INTERRUPT) = BIT(CAN_TX_INTERRUPT % 32) | BIT(CAN_RX0_INTERRUPT % 32);
}

bool can_is_empty(void)
{
    return received.head == received.tail;
}

bool can_read(UuvHilCanFrame *frame)
{
    return get(&received, frame);
}

void can_write(const UuvHilCanFrame *frame)
{
    put(&to_send, frame);
    interrupts_off();
    send_stored();
    interrupts_on();
}
