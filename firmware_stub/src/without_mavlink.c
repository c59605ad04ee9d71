/* Replaces mavlink.c if pymavlink, which generates its headers, is not installed: no packet is MAVLink. */

#include "uuv_hil_stm32.h"

void uuv_hil_mavlink_start(UuvHilMavlink *mavlink, uint8_t channels)
{
    (void)channels;
    *mavlink = (UuvHilMavlink){.commander = -1};
}

UuvHilReceived uuv_hil_mavlink_feed(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, uint8_t byte,
                                    uint64_t now_us, UuvHilCommand *command)
{
    (void)mavlink, (void)platform, (void)byte, (void)now_us, (void)command;
    return UUV_HIL_NOTHING;
}

void uuv_hil_mavlink_report(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, const UuvHilTelemetry *telemetry,
                            uint64_t now_us)
{
    (void)mavlink, (void)platform, (void)telemetry, (void)now_us;
}

void uuv_hil_mavlink_tick(UuvHilMavlink *mavlink, const UuvHilPlatform *platform, uint64_t now_us)
{
    (void)mavlink, (void)platform, (void)now_us;
}
