/* Answer the requests that a ground station sends to every vehicle: a part of hil/links/mavlink/ground_station.py. */

#include "mavlink_messages.h"

#define PARAMETER "SYSID_THISMAV"
#define FTP_REQUEST_CODE 3 /* places in the payload of FILE_TRANSFER_PROTOCOL */
#define FTP_OFFSET 8
#define FTP_DATA 12
#define FTP_ACK 128
#define FTP_NAK 129
#define FTP_UNKNOWN_COMMAND 7

/* A received request. Decode the whole packet: only then are the bytes that it leaves out at its end zeros. */
typedef struct {
    const mavlink_message_t *packet;
    mavlink_status_t *link_status;
    mavlink_message_t *answer;
} Request;

static bool send_parameter(const Request *received)
{
    mavlink_param_value_t value = {
        .param_value = (float)UUV_HIL_MAVLINK_SYSTEM,
        .param_type = MAV_PARAM_TYPE_INT16,
        .param_count = 1,
    };
    memcpy(value.param_id, PARAMETER, sizeof PARAMETER);
    mavlink_msg_param_value_encode_status(UUV_HIL_MAVLINK_SYSTEM, UUV_HIL_MAVLINK_COMPONENT, received->link_status,
                                          received->answer, &value);
    return true;
}

/* The field is filled up with zeros behind the name. */
static bool is_parameter(const char *name)
{
    for (size_t i = 0; i < sizeof PARAMETER; i++)
        if (name[i] != PARAMETER[i])
            return false;
    return true;
}

static bool list_parameters(const Request *received)
{
    mavlink_param_request_list_t request;
    mavlink_msg_param_request_list_decode(received->packet, &request);
    return uuv_hil_mavlink_is_for_us(request.target_system, request.target_component) && send_parameter(received);
}

static bool read_parameter(const Request *received)
{
    mavlink_param_request_read_t request;
    mavlink_msg_param_request_read_decode(received->packet, &request);
    return uuv_hil_mavlink_is_for_us(request.target_system, request.target_component)
           && (request.param_index == 0 || is_parameter(request.param_id)) && send_parameter(received);
}

/* The parameter cannot be changed: the answer has its value. */
static bool set_parameter(const Request *received)
{
    mavlink_param_set_t request;
    mavlink_msg_param_set_decode(received->packet, &request);
    return uuv_hil_mavlink_is_for_us(request.target_system, request.target_component) && is_parameter(request.param_id)
           && send_parameter(received);
}

static bool list_mission(const Request *received)
{
    mavlink_mission_request_list_t request;
    mavlink_msg_mission_request_list_decode(received->packet, &request);
    if (!uuv_hil_mavlink_is_for_us(request.target_system, request.target_component))
        return false;
    const mavlink_mission_count_t count = {
        .target_system = received->packet->sysid,
        .target_component = received->packet->compid,
        .mission_type = request.mission_type,
    };
    mavlink_msg_mission_count_encode_status(UUV_HIL_MAVLINK_SYSTEM, UUV_HIL_MAVLINK_COMPONENT, received->link_status,
                                            received->answer, &count);
    return true;
}

static bool acknowledge(const Request *received, uint8_t system, uint8_t component, uint8_t mission_type,
                        uint8_t result)
{
    if (!uuv_hil_mavlink_is_for_us(system, component))
        return false;
    const mavlink_mission_ack_t ack = {
        .target_system = received->packet->sysid,
        .target_component = received->packet->compid,
        .type = result,
        .mission_type = mission_type,
    };
    mavlink_msg_mission_ack_encode_status(UUV_HIL_MAVLINK_SYSTEM, UUV_HIL_MAVLINK_COMPONENT, received->link_status,
                                          received->answer, &ack);
    return true;
}

static bool refuse_mission(const Request *received)
{
    mavlink_mission_count_t request;
    mavlink_msg_mission_count_decode(received->packet, &request);
    uint8_t result = request.count != 0 ? MAV_MISSION_NO_SPACE : MAV_MISSION_ACCEPTED;
    return acknowledge(received, request.target_system, request.target_component, request.mission_type, result);
}

static bool clear_mission(const Request *received)
{
    mavlink_mission_clear_all_t request;
    mavlink_msg_mission_clear_all_decode(received->packet, &request);
    return acknowledge(received, request.target_system, request.target_component, request.mission_type,
                       MAV_MISSION_ACCEPTED);
}

static bool refuse_item(const Request *received, uint8_t system, uint8_t component, uint8_t mission_type)
{
    return acknowledge(received, system, component, mission_type, MAV_MISSION_INVALID_SEQUENCE);
}

static bool refuse_request(const Request *received)
{
    mavlink_mission_request_t request;
    mavlink_msg_mission_request_decode(received->packet, &request);
    return refuse_item(received, request.target_system, request.target_component, request.mission_type);
}

static bool refuse_request_int(const Request *received)
{
    mavlink_mission_request_int_t request;
    mavlink_msg_mission_request_int_decode(received->packet, &request);
    return refuse_item(received, request.target_system, request.target_component, request.mission_type);
}

static bool refuse_sent_item(const Request *received)
{
    mavlink_mission_item_t request;
    mavlink_msg_mission_item_decode(received->packet, &request);
    return refuse_item(received, request.target_system, request.target_component, request.mission_type);
}

static bool refuse_sent_item_int(const Request *received)
{
    mavlink_mission_item_int_t request;
    mavlink_msg_mission_item_int_decode(received->packet, &request);
    return refuse_item(received, request.target_system, request.target_component, request.mission_type);
}

static bool refuse_file(const Request *received)
{
    mavlink_file_transfer_protocol_t request;
    mavlink_msg_file_transfer_protocol_decode(received->packet, &request);
    uint8_t code = request.payload[FTP_REQUEST_CODE];
    if (!uuv_hil_mavlink_is_for_us(request.target_system, request.target_component) || code == 0 || code == FTP_ACK
        || code == FTP_NAK)
        return false; /* an answer, or nothing */
    uint16_t number = (uint16_t)((request.payload[0] | request.payload[1] << 8) + 1);
    mavlink_file_transfer_protocol_t refusal = {
        .target_system = received->packet->sysid,
        .target_component = received->packet->compid,
        .payload = {(uint8_t)number, (uint8_t)(number >> 8), request.payload[2], FTP_NAK, 1, code},
    };
    memcpy(refusal.payload + FTP_OFFSET, request.payload + FTP_OFFSET, FTP_DATA - FTP_OFFSET);
    refusal.payload[FTP_DATA] = FTP_UNKNOWN_COMMAND;
    mavlink_msg_file_transfer_protocol_encode_status(UUV_HIL_MAVLINK_SYSTEM, UUV_HIL_MAVLINK_COMPONENT,
                                                     received->link_status, received->answer, &refusal);
    return true;
}

bool uuv_hil_mavlink_answer(const mavlink_message_t *packet, mavlink_status_t *link_status, mavlink_message_t *answer)
{
    const Request received = {packet, link_status, answer};
    switch (packet->msgid) {
    case MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
        return list_parameters(&received);
    case MAVLINK_MSG_ID_PARAM_REQUEST_READ:
        return read_parameter(&received);
    case MAVLINK_MSG_ID_PARAM_SET:
        return set_parameter(&received);
    case MAVLINK_MSG_ID_MISSION_REQUEST_LIST:
        return list_mission(&received);
    case MAVLINK_MSG_ID_MISSION_COUNT:
        return refuse_mission(&received);
    case MAVLINK_MSG_ID_MISSION_CLEAR_ALL:
        return clear_mission(&received);
    case MAVLINK_MSG_ID_MISSION_REQUEST:
        return refuse_request(&received);
    case MAVLINK_MSG_ID_MISSION_REQUEST_INT:
        return refuse_request_int(&received);
    case MAVLINK_MSG_ID_MISSION_ITEM:
        return refuse_sent_item(&received);
    case MAVLINK_MSG_ID_MISSION_ITEM_INT:
        return refuse_sent_item_int(&received);
    case MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL:
        return refuse_file(&received);
    default:
        return false;
    }
}
