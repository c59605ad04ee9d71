/* The generated messages, and what both parts of the MAVLink end need of them. Private to mavlink*.c. */
#ifndef UUV_HIL_MAVLINK_MESSAGES_H
#define UUV_HIL_MAVLINK_MESSAGES_H

#define MAVLINK_NO_CONVERSION_HELPERS
#define MAVLINK_NO_SIGN_PACKET
#define MAVLINK_NO_SIGNATURE_CHECK
#include <uuv_hil/mavlink.h>

#include "uuv_hil_stm32.h"

#define UUV_HIL_MAVLINK_SYSTEM 1
#define UUV_HIL_MAVLINK_COMPONENT 1

/* Return whether a packet with this target is for this component. */
static inline bool uuv_hil_mavlink_is_for_us(uint8_t system, uint8_t component)
{
    return (system == 0 || system == UUV_HIL_MAVLINK_SYSTEM) && (component == 0 || component == UUV_HIL_MAVLINK_COMPONENT);
}

/* mavlink_answers.c: write the answer to a request that a ground station sends to every vehicle: one parameter, no
 * mission, no files. Twin of hil/links/mavlink/ground_station.py. Returns whether `packet` has an answer. */
bool uuv_hil_mavlink_answer(const mavlink_message_t *packet, mavlink_status_t *link_status, mavlink_message_t *answer);

#endif
