/*
 * Prints the content of an sbgECom file as read by the manufacturer's library.
 *
 *     read PATH
 *
 * Each intact frame is a line: "frame CLASS MESSAGE BYTES". For messages that boresight reads, a second
 * line holds the library's values, with all digits.
 */
#include <sbgEComLib.h>

#include <stdio.h>
#include <stdlib.h>

static bool is_over;

static SbgErrorCode from_file(SbgInterface *source, void *bytes, size_t *read, size_t size)
{
    *read = fread(bytes, 1, size, (FILE *)source->handle);
    is_over = *read == 0;
    return SBG_NO_ERROR;
}

static SbgErrorCode to_nowhere(SbgInterface *source, const void *bytes, size_t size)
{
    (void)source, (void)bytes, (void)size;
    return SBG_NO_ERROR;
}

static void on_frame(SbgEComProtocol *protocol, uint8_t class, uint8_t message,
                     SbgStreamBuffer *frame, void *argument)
{
    (void)protocol, (void)argument;
    printf("frame %u %u %zu\n", class, message, sbgStreamBufferGetSize(frame));
}

static void print_imu_short(const SbgEComLogImuShort *log)
{
    printf("imu_short %u %u", log->timeStamp, log->status);
    for (int i = 0; i < 3; i++)
        printf(" %d %.9g", log->deltaAngle[i], sbgEComLogImuShortGetDeltaAngle(log, i));
    for (int i = 0; i < 3; i++)
        printf(" %d %.9g", log->deltaVelocity[i], sbgEComLogImuShortGetDeltaVelocity(log, i));
    printf("\n");
}

static void print_imu_data(const SbgEComLogImuLegacy *log)
{
    printf("imu_data %u %u", log->timeStamp, log->status);
    for (int i = 0; i < 3; i++)
        printf(" %.9g", log->deltaAngle[i]);
    for (int i = 0; i < 3; i++)
        printf(" %.9g", log->deltaVelocity[i]);
    printf("\n");
}

static void print_utc(const SbgEComLogUtc *log)
{
    printf("utc %u %d %d %d %d %d %d %d %d %d %d\n", log->timeStamp, sbgEComLogUtcGetUtcStatus(log),
           sbgEComLogUtcTimeIsAccurate(log), sbgEComLogUtcGetClockState(log), log->year, log->month,
           log->day, log->hour, log->minute, log->second, log->nanoSecond);
}

static void print_hdt(const SbgEComLogGnssHdt *log)
{
    /* The library checks only the accuracies. */
    bool has_solution = sbgEComLogGnssHdtGetStatus(log) == SBG_ECOM_GNSS_HDT_STATUS_SOL_COMPUTED;
    printf("hdt %u %d %d %.9g %.9g %.9g %.9g\n", log->timeStamp,
           has_solution && sbgEComLogGnssHdtHeadingIsValid(log), sbgEComLogGnssHdtPitchIsValid(log), log->heading,
           log->headingAccuracy, log->pitch, log->pitchAccuracy);
}

static void print_pos(const SbgEComLogGnssPos *log)
{
    printf("pos %u %d %d %.17g %.17g %.17g %.9g %.9g %.9g %.9g\n", log->timeStamp,
           sbgEComLogGnssPosGetStatus(log), sbgEComLogGnssPosGetType(log), log->latitude,
           log->longitude, log->altitude, log->undulation, log->latitudeAccuracy,
           log->longitudeAccuracy, log->altitudeAccuracy);
}

static SbgErrorCode on_log(SbgEComHandle *handle, SbgEComClass class, SbgEComMsgId message,
                           const SbgEComLogUnion *log, void *argument)
{
    (void)handle, (void)argument;
    if (class != SBG_ECOM_CLASS_LOG_ECOM_0)
        return SBG_NO_ERROR;
    switch (message) {
    case SBG_ECOM_LOG_IMU_SHORT:
        print_imu_short(&log->imuShort);
        break;
    case SBG_ECOM_LOG_IMU_DATA:
        print_imu_data(&log->imuData);
        break;
    case SBG_ECOM_LOG_UTC_TIME:
        print_utc(&log->utcData);
        break;
    case SBG_ECOM_LOG_GPS1_HDT:
        print_hdt(&log->gpsHdtData);
        break;
    case SBG_ECOM_LOG_GPS1_POS:
        print_pos(&log->gpsPosData);
        break;
    default:
        break;
    }
    return SBG_NO_ERROR;
}

int main(int count, char **arguments)
{
    FILE *file = count == 2 ? fopen(arguments[1], "rb") : NULL;
    if (!file) {
        fprintf(stderr, "read: no file\n");
        return 1;
    }
    SbgInterface source;
    SbgEComHandle handle;
    sbgInterfaceZeroInit(&source);
    source.handle = file;
    source.pReadFunc = from_file;
    source.pWriteFunc = to_nowhere;
    if (sbgEComInit(&handle, &source) != SBG_NO_ERROR)
        return 1;
    sbgEComSetReceiveLogCallback(&handle, on_log, NULL);
    sbgEComProtocolSetOnFrameReceivedCb(&handle.protocolHandle, on_frame, NULL);
    while (sbgEComHandleOneLog(&handle) != SBG_NOT_READY || !is_over)
        ;
    sbgEComClose(&handle);
    fclose(file);
    return 0;
}
