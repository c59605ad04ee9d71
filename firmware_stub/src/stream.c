/* Find packets in a stream of bytes, like hil/links/frame/readers.py but one byte at a time.
 *
 * The beginnings of packets are not checked with every byte, but only when there are enough bytes for a new result:
 * checks with every byte would take most of the time between a command and its answer.
 */

#include "uuv_hil_stm32.h"

static void drop(UuvHilStream *stream, size_t count)
{
    stream->dropped_bytes = (uint16_t)(stream->dropped_bytes + count);
    stream->length = (uint16_t)(stream->length - count);
    for (size_t i = 0; i < stream->length; i++)
        stream->bytes[i] = stream->bytes[i + count];
}

static const uint8_t *consume_packet(UuvHilStream *stream, size_t start)
{
    stream->dropped_bytes = (uint16_t)(stream->dropped_bytes + start);
    stream->length = 0;
    return stream->bytes + start;
}

static const uint8_t *find_packet(UuvHilStream *stream, const UuvHilFormat *format)
{
    size_t length = stream->length;
    size_t unfinished_from = length; /* start of the first unfinished packet */
    size_t next_check = SIZE_MAX;
    for (size_t start = 0; start < length; start++) {
        const uint8_t *packet = stream->bytes + start;
        if (*packet != format->first)
            continue;
        size_t size = format->size(packet, length - start);
        if (size == 0)
            continue;
        size_t end = start + size;
        if (end == length && format->is_valid(packet, size))
            return consume_packet(stream, start);
        if (end > length && end < next_check)
            next_check = end;
        if (unfinished_from < length)
            continue; /* it is checked when the packet before it is complete */
        if (end > length)
            unfinished_from = start;
        else
            stream->checksum_errors++;
    }
    drop(stream, unfinished_from);
    stream->next_check = (uint16_t)(next_check - unfinished_from);
    return NULL;
}

const uint8_t *uuv_hil_stream_feed(UuvHilStream *stream, const UuvHilFormat *format, uint8_t byte)
{
    bool may_begin = byte == format->first;
    if (stream->length == 0 && !may_begin) {
        stream->dropped_bytes++;
        return NULL;
    }
    stream->bytes[stream->length++] = byte;
    return stream->length < stream->next_check && !may_begin ? NULL : find_packet(stream, format);
}
