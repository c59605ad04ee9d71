/* The firmware of the STM32 that drives the thrusters: from received bytes to pulses. This header is its manual.
 *
 * It behaves like firmware_stub/stub.py, byte for byte. It allocates no memory, stores its state only in the
 * structures of its caller, and needs only the functions of UuvHilPlatform:
 *
 *     static UuvHilFirmware firmware;
 *     uuv_hil_start(&firmware, &platform, 6, 200000);
 *     for (;;)
 *         uuv_hil_service(&firmware, bytes, count);      // when bytes were received, or at uuv_hil_deadline_us
 *
 *     power-up    all outputs 1500 us, disarmed
 *     command     applied if it has one pulse width per thruster and is not late; with `armed` the outputs
 *                 get its pulse widths, otherwise 1500 us
 *     watchdog    no command applied for watchdog_us, armed or not: all outputs 1500 us, disarmed, timed_out,
 *                 reported at once. The next command clears timed_out and is applied like any other
 *     report      after each applied command, and at least every 200 ms
 *
 * A command whose sequence number is 1 to 32 behind the last is late (it was overtaken) and is refused. The same
 * number, or one further behind (the host has restarted), is applied. After a watchdog trip every number is applied.
 *
 * Protocols: on the UART the frame of frames/uuv_hil.toml and MAVLink 2, on CAN that of VESC motor controllers.
 * Reports are in the protocol of the last valid message; before the first one, in the frame.
 */
#ifndef UUV_HIL_STM32_H
#define UUV_HIL_STM32_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "uuv_hil_frame.h"

#define UUV_HIL_MAX_CHANNELS 16u
#define UUV_HIL_PWM_NEUTRAL_US 1500u
#define UUV_HIL_PWM_MIN_US 800u  /* a pulse below, or above the next, is "no pulse": 0 */
#define UUV_HIL_PWM_MAX_US 2200u
#define UUV_HIL_NO_PULSE_US 0u
#define UUV_HIL_WATCHDOG_US 200000u
#define UUV_HIL_TELEMETRY_PERIOD_US 200000u
#define UUV_HIL_LATE_WINDOW 32u          /* sequence numbers */
#define UUV_HIL_NEVER_US UINT32_MAX      /* the age if there was no command, or none for too long */
#define UUV_HIL_NEVER_DUE_US UINT64_MAX

typedef struct {
    uint16_t sequence;
    bool armed;
    uint8_t channels;
    uint16_t pwm_us[UUV_HIL_MAX_CHANNELS];
} UuvHilCommand;

typedef struct {
    uint16_t sequence; /* of the last applied command */
    bool armed;
    bool timed_out;
    uint8_t channels;
    uint32_t age_us; /* from applying that command to this report */
    uint16_t frames; /* applied commands; the three counters wrap */
    uint16_t errors; /* refused commands, damaged frames */
    uint16_t watchdog_trips;
    uint16_t pwm_us[UUV_HIL_MAX_CHANNELS];
} UuvHilTelemetry;

/* ---- board.c: outputs, arming, watchdog, counters. No I/O. Instants are microseconds of one clock that
 * never runs backwards. ---- */

typedef struct {
    uint8_t channels;
    bool armed;
    bool timed_out;
    uint16_t pwm_us[UUV_HIL_MAX_CHANNELS];
    uint16_t sequence;
    uint16_t frames;
    uint16_t refused;
    uint16_t line_errors; /* set by the code that reads the line */
    uint16_t watchdog_trips;
    uint32_t watchdog_us;
    uint64_t applied_us;       /* UUV_HIL_NEVER_DUE_US: never */
    uint64_t watchdog_due_us;  /* when the watchdog trips; UUV_HIL_NEVER_DUE_US: it has tripped, or was not started */
    uint64_t telemetry_due_us;
} UuvHilBoard;

/* channels: 1 to UUV_HIL_MAX_CHANNELS. */
void uuv_hil_board_start(UuvHilBoard *board, uint8_t channels, uint32_t watchdog_us);

/* Apply a command. Returns whether it was applied. A refused one is counted, and does not reset the watchdog. */
bool uuv_hil_board_command(UuvHilBoard *board, const UuvHilCommand *command, uint64_t now_us);

/* Advance the time: trip the watchdog when it is due. Returns whether telemetry is to be sent now. */
bool uuv_hil_board_tick(UuvHilBoard *board, uint64_t now_us);

/* Return the report of this instant. The next one is due a period later; missed ones are skipped. */
UuvHilTelemetry uuv_hil_board_telemetry(UuvHilBoard *board, uint64_t now_us);

/* Set all outputs to 1500 us, now. */
void uuv_hil_board_disarm(UuvHilBoard *board);

/* Return when uuv_hil_board_tick has to be called next, unless a command is received before. */
uint64_t uuv_hil_board_deadline_us(const UuvHilBoard *board);

/* ---- stream.c: find valid packets in a stream of bytes. A packet is delivered with its last byte:
 * an incomplete packet or a damaged length before it does not delay it. ---- */

#define UUV_HIL_PACKET_LONGEST 280u /* a signed MAVLink 2 packet; the frame has 261 at most */

typedef struct {
    /* Return the size of the packet that begins with these `available` bytes. If these are too few, return the number
     * of bytes at which to call it again. Return 0 if no packet begins like this. */
    size_t (*size)(const uint8_t *bytes, size_t available);
    bool (*is_valid)(const uint8_t *packet, size_t size);
    uint8_t first; /* first byte of every packet; `size` is not called for others */
} UuvHilFormat;

typedef struct {
    uint8_t bytes[UUV_HIL_PACKET_LONGEST]; /* the beginning of an incomplete packet */
    uint16_t length;
    uint16_t next_check;         /* the length at which the stored bytes have to be checked again */
    uint16_t checksum_errors; /* both counters wrap */
    uint16_t dropped_bytes;
} UuvHilStream;

/* Add one received byte. Returns the valid packet that it completes, unchanged until the next call, or NULL.
 * A stream starts as all zeros. */
const uint8_t *uuv_hil_stream_feed(UuvHilStream *stream, const UuvHilFormat *format, uint8_t byte);

/* ---- frame.c: the bytes of frames/uuv_hil.toml. ---- */

extern const UuvHilFormat uuv_hil_frame_format;

/* Return the CRC-16/CCITT-FALSE of size bytes. */
uint16_t uuv_hil_crc16(const uint8_t *data, size_t size);

/* Decode a valid frame. Returns whether it is a command. */
bool uuv_hil_frame_decode(const uint8_t *frame, UuvHilCommand *command);

/* Write the frame of a report, at most UUV_HIL_FRAME_TELEMETRY_FRAME_SIZE_MAX bytes. Returns its size. */
size_t uuv_hil_frame_encode(const UuvHilTelemetry *telemetry, uint8_t *out);

/* ---- The functions that the core needs of a machine. ---- */

typedef struct {
    uint32_t id; /* of 29 bits */
    uint8_t size;
    uint8_t data[8];
} UuvHilCanFrame;

typedef struct {
    void *context; /* passed to each function */
    uint64_t (*now_us)(void *context);
    /* Sends all of data or, without room for it, nothing. Never blocks. */
    void (*uart_write)(void *context, const uint8_t *data, size_t size);
    void (*can_write)(void *context, const UuvHilCanFrame *frame); /* likewise */
    void (*pwm_set)(void *context, const uint16_t *pulse_us, uint8_t channels);
    void (*watchdog_kick)(void *context); /* the hardware watchdog: called once in each uuv_hil_service */
} UuvHilPlatform;

typedef enum {
    UUV_HIL_NOTHING,
    UUV_HIL_VALID,   /* a valid packet, answered or ignored */
    UUV_HIL_COMMAND, /* a valid packet, and *command is the command for the board */
} UuvHilReceived;

/* ---- mavlink.c: the device's end of hil/links/mavlink/link.py, on the headers that pymavlink generates. It applies
 * SERVO_OUTPUT_RAW, RC_CHANNELS_OVERRIDE and, as COMMAND_LONG, COMPONENT_ARM_DISARM and DO_SET_SERVO; it sends
 * SERVO_OUTPUT_RAW as report, HEARTBEAT and SYS_STATUS once a second and when armed or timed out change,
 * COMMAND_ACK, and answers to TIMESYNC. It is component 1 of system 1, and checks no signatures.
 * without_mavlink.c replaces it if pymavlink is not installed. ---- */

typedef struct {
    UuvHilStream packets;
    uint8_t packets_sent; /* wraps: the number of the next packet */
    uint64_t heartbeat_due_us;
    UuvHilTelemetry reported; /* the last report */
    UuvHilCommand command;    /* the last command, and the state that the next one changes */
    int32_t commander;        /* its sender, system << 8 | component; -1: none yet */
    uint8_t number;           /* of its packet; `command.sequence` is this, continued to 16 bits */
} UuvHilMavlink;

void uuv_hil_mavlink_start(UuvHilMavlink *mavlink, uint8_t channels);

/* Add one received byte, and send the answer to the packet that it completes. */
UuvHilReceived uuv_hil_mavlink_feed(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, uint8_t byte,
                                    uint64_t now_us, UuvHilCommand *command);

void uuv_hil_mavlink_report(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, const UuvHilTelemetry *telemetry,
                            uint64_t now_us);

/* HEARTBEAT and SYS_STATUS, if they are due. */
void uuv_hil_mavlink_tick(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, uint64_t now_us);

/* ---- vesc.c: the device's end of hil/links/vesc/link.py, as controllers 1 to `channels` at once. It applies SET_DUTY,
 * SET_CURRENT_REL and SET_CURRENT 0, which releases the motor; commands to all controllers, or one that is received
 * again before that, make one command of the board. It sends STATUS. ---- */

typedef struct {
    uint16_t output_us;  /* present output; UUV_HIL_NO_PULSE_US: none */
    uint16_t pending_us; /* output of the command that is being assembled */
    bool is_pending;
    uint64_t received_us;
} UuvHilVescMotor;

typedef struct {
    uint8_t channels;
    uint8_t pending_count; /* motors with a received output that is not applied yet */
    UuvHilVescMotor motors[UUV_HIL_MAX_CHANNELS];
    uint16_t malformed; /* frames to these controllers that are not supported; wraps */
} UuvHilVesc;

void uuv_hil_vesc_start(UuvHilVesc *vesc, uint8_t channels);

UuvHilReceived uuv_hil_vesc_receive(UuvHilVesc *vesc, const UuvHilCanFrame *frame, uint64_t now_us,
                                    UuvHilCommand *command);

/* Return the STATUS frame of the controller of a thruster, counted from 0. */
UuvHilCanFrame uuv_hil_vesc_status(uint8_t thruster, uint16_t pulse_us);

/* ---- firmware.c: all parts together, on a platform. ---- */

typedef enum { UUV_HIL_PROTOCOL_FRAME, UUV_HIL_PROTOCOL_MAVLINK, UUV_HIL_PROTOCOL_VESC } UuvHilProtocol;

typedef struct {
    const UuvHilPlatform *platform;
    UuvHilBoard board;
    UuvHilStream frames;
    uint16_t malformed; /* valid frames that are no command; wraps */
    UuvHilMavlink mavlink;
    UuvHilVesc vesc;
    UuvHilProtocol protocol;
} UuvHilFirmware;

/* Start with neutral outputs. The caller owns the platform, which must exist as long as the firmware. */
void uuv_hil_start(UuvHilFirmware *firmware, const UuvHilPlatform *platform, uint8_t channels, uint32_t watchdog_us);

/* Process a received CAN frame: apply and answer the command that it completes. */
void uuv_hil_receive_can(UuvHilFirmware *firmware, const UuvHilCanFrame *frame);

/* Process `size` received bytes (also 0), apply and answer each command in them, then advance the time. Bytes are
 * processed before the watchdog is checked, so that a late machine is not mistaken for a host that stopped. */
void uuv_hil_service(UuvHilFirmware *firmware, const uint8_t *bytes, size_t size);

/* Return the time at which uuv_hil_service has to be called even without bytes. */
uint64_t uuv_hil_deadline_us(const UuvHilFirmware *firmware);

/* Set the outputs to neutral before the program ends. */
void uuv_hil_stop(UuvHilFirmware *firmware);

#endif
