/* Find packets in a stream of bytes, like hil/links/frame/readers.py but one byte at a time.
 *
 * The packets that may have begun are checked only when the bytes suffice to decide more, and not with every byte:
 * that would take most of the time between a command and its answer.
 */

#include "uuv_hil_stm32.h"

static void drop(UuvHilStream *stream, size_t count)
{
    stream->dropped_bytes = (uint16_t)(stream->dropped_bytes + count);
    stream->length = (uint16_t)(stream->length - count);
    for (size_t i = 0; i < stream->length; i++)
        stream->bytes[i] = stream->bytes[i + count];
}

static const uint8_t *take(UuvHilStream *stream, size_t start)
{
    stream->dropped_bytes = (uint16_t)(stream->dropped_bytes + start);
    stream->length = 0;
    return stream->bytes + start;
}

static const uint8_t *look(UuvHilStream *stream, const UuvHilFormat *format)
{
    size_t length = stream->length;
    size_t kept_from = length; /* where the first unfinished packet begins */
    size_t look_at = SIZE_MAX;
    for (size_t start = 0; start < length; start++) {
        const uint8_t *packet = stream->bytes + start;
        if (*packet != format->first)
            continue;
        size_t size = format->size(packet, length - start);
        if (size == 0)
            continue;
        size_t end = start + size;
        if (end == length && format->is_sound(packet, size))
            return take(stream, start);
        if (end > length && end < look_at)
            look_at = end;
        if (kept_from < length)
            continue; /* it is checked when what precedes it is finished */
        if (end > length)
            kept_from = start;
        else
            stream->checksum_errors++;
    }
    drop(stream, kept_from);
    stream->look_at = (uint16_t)(look_at - kept_from);
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
    return stream->length < stream->look_at && !may_begin ? NULL : look(stream, format);
}
