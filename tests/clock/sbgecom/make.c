/*
 * Makes an sbgECom stream with the manufacturer's library, and sends it as a sensor does.
 *
 *     make SECONDS short|data file PATH
 *     make SECONDS short|data tcp PORT     serves one client on loopback
 *     make SECONDS short|data udp PORT     sends a datagram for each frame, ten times as fast as a sensor
 *
 * An IMU at 200 Hz (IMU_SHORT or IMU_DATA), EKF_EULER, EKF_QUAT and EKF_NAV at 50 Hz, GPS1_HDT and
 * GPS1_POS at 5 Hz, UTC_TIME and STATUS at 1 Hz. The clock of the device rolls over twenty minutes after
 * the start and drifts against UTC. The first ten UTC_TIME messages have no valid UTC, the next ten no known
 * leap seconds, the next ten no accurate UTC; some samples and fixes are not usable.
 */
#include <sbgEComLib.h>

#include <arpa/inet.h>
#include <math.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

/* 2024-02-28T23:30:00Z, seconds of the day: an hour ends on the leap day. */
#define START_S 84600
#define ROLL_OVER_S 1200

static SbgEComProtocol protocol;
static uint64_t state = 88172645463325252u;

static void fail(const char *what)
{
    fprintf(stderr, "make: %s\n", what);
    exit(1);
}

/* Uniformly distributed between -1 and 1. */
static double noise(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(int64_t)state / 9223372036854775808.0;
}

static SbgErrorCode to_file(SbgInterface *sink, const void *bytes, size_t size)
{
    return fwrite(bytes, 1, size, (FILE *)sink->handle) == size ? SBG_NO_ERROR : SBG_WRITE_ERROR;
}

static SbgErrorCode to_nowhere(SbgInterface *sink, void *bytes, size_t *read, size_t size)
{
    (void)sink, (void)bytes, (void)size;
    *read = 0;
    return SBG_NO_ERROR;
}

/* A client on loopback, as a file. */
static FILE *accept_one(int port)
{
    struct sockaddr_in place = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    int yes = 1, server = socket(AF_INET, SOCK_STREAM, 0);
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    setsockopt(server, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (bind(server, (struct sockaddr *)&place, sizeof place) || listen(server, 1))
        fail("the port is taken");
    int client = accept(server, NULL, NULL);
    FILE *file = client < 0 ? NULL : fdopen(client, "w");
    if (!file)
        fail("no client");
    return file;
}

static void send_log(SbgEComMsgId id, SbgErrorCode (*write)(const void *, SbgStreamBuffer *), const void *log)
{
    uint8_t bytes[SBG_ECOM_MAX_PAYLOAD_SIZE];
    SbgStreamBuffer stream;
    sbgStreamBufferInitForWrite(&stream, bytes, sizeof bytes);
    if (write(log, &stream) != SBG_NO_ERROR)
        fail("a log is not written");
    if (sbgEComProtocolSend(&protocol, SBG_ECOM_CLASS_LOG_ECOM_0, (uint8_t)id, bytes,
                            sbgStreamBufferGetLength(&stream)) != SBG_NO_ERROR)
        fail("a frame is not sent");
}
#define SEND(id, Log, log)                                                                         \
    send_log(SBG_ECOM_LOG_##id,                                                                    \
             (SbgErrorCode(*)(const void *, SbgStreamBuffer *))sbgEComLog##Log##WriteToStream, &(log))

static void send_imu(uint32_t stamp, long sample, bool is_short)
{
    uint16_t ok = SBG_ECOM_IMU_COM_OK | SBG_ECOM_IMU_STATUS_BIT | SBG_ECOM_IMU_ACCELS_IN_RANGE |
                  SBG_ECOM_IMU_GYROS_IN_RANGE;
    /* Some samples without communication with the IMU, some rates that need the other scale. */
    uint16_t status = sample % 997 == 500 ? 0 : ok;
    double turn = sample % 4001 == 2000 ? 80.0 : 1.5;
    float accel[3], gyro[3];
    for (int i = 0; i < 3; i++) {
        accel[i] = (float)(20.0 * noise() - (i == 2 ? 9.8 : 0.0));
        gyro[i] = (float)(turn * noise());
    }
    if (is_short) {
        SbgEComLogImuShort log = {.timeStamp = stamp, .status = status};
        sbgEComLogImuShortSetDeltaVelocity(&log, accel, 3);
        sbgEComLogImuShortSetDeltaAngle(&log, gyro, 3);
        sbgEComLogImuShortSetTemperature(&log, (float)(25.0 + noise()));
        SEND(IMU_SHORT, ImuShort, log);
    } else {
        SbgEComLogImuLegacy log = {.timeStamp = stamp, .status = status, .temperature = 25.5f};
        for (int i = 0; i < 3; i++) {
            log.accelerometers[i] = (float)(accel[i] + noise());
            log.gyroscopes[i] = (float)(gyro[i] + noise());
            log.deltaVelocity[i] = accel[i];
            log.deltaAngle[i] = gyro[i];
        }
        SEND(IMU_DATA, ImuLegacy, log);
    }
}

static void send_ekf(uint32_t stamp)
{
    SbgEComLogEkfEuler euler = {.timeStamp = stamp, .status = 0x1234567, .magDeclination = 0.05f};
    SbgEComLogEkfQuat quat = {.timeStamp = stamp, .status = 0x1234567};
    SbgEComLogEkfNav nav = {.timeStamp = stamp, .status = 0x1234567, .undulation = 47.5f};
    for (int i = 0; i < 3; i++) {
        euler.euler[i] = (float)noise();
        euler.eulerStdDev[i] = quat.eulerStdDev[i] = (float)(0.01 * fabs(noise()));
        nav.velocity[i] = (float)(10.0 * noise());
        nav.velocityStdDev[i] = nav.positionStdDev[i] = (float)fabs(noise());
        nav.position[i] = 50.0 * noise();
    }
    for (int i = 0; i < 4; i++)
        quat.quaternion[i] = (float)noise();
    SEND(EKF_EULER, EkfEuler, euler);
    SEND(EKF_QUAT, EkfQuat, quat);
    SEND(EKF_NAV, EkfNav, nav);
}

static void send_gnss(uint32_t stamp, long fix)
{
    SbgEComLogGnssHdt hdt;
    sbgEComLogGnssHdtZeroInit(&hdt);
    hdt.timeStamp = stamp;
    hdt.timeOfWeek = (uint32_t)(200 * fix);
    sbgEComLogGnssHdtSetStatus(&hdt, fix % 50 == 7 ? SBG_ECOM_GNSS_HDT_STATUS_INSUFFICIENT_OBS
                                                   : SBG_ECOM_GNSS_HDT_STATUS_SOL_COMPUTED);
    sbgEComLogGnssHdtSetBaseLineValid(&hdt, true);
    hdt.heading = (float)(180.0 + 179.9 * noise());
    hdt.pitch = (float)(20.0 * noise());
    /* An accuracy of 180 degrees stands for none. */
    hdt.headingAccuracy = fix % 50 == 9 ? 180.0f : (float)(0.1 + 0.05 * noise());
    hdt.pitchAccuracy = fix % 50 == 11 ? 90.0f : (float)(0.2 + 0.05 * noise());
    hdt.baseline = 1.25f;
    SEND(GPS1_HDT, GnssHdt, hdt);

    SbgEComLogGnssPos pos;
    sbgEComLogGnssPosZeroInit(&pos);
    pos.timeStamp = stamp;
    pos.timeOfWeek = (uint32_t)(200 * fix);
    sbgEComLogGnssPosSetStatus(&pos, fix % 50 == 13 ? SBG_ECOM_GNSS_POS_STATUS_INSUFFICIENT_OBS
                                                    : SBG_ECOM_GNSS_POS_STATUS_SOL_COMPUTED);
    sbgEComLogGnssPosSetType(&pos, SBG_ECOM_GNSS_POS_TYPE_RTK_INT);
    pos.latitude = 48.0 + 0.01 * noise();
    pos.longitude = 9.0 + 0.01 * noise();
    pos.altitude = 400.0 + noise();
    pos.undulation = (float)(47.0 + 0.1 * noise());
    pos.latitudeAccuracy = (float)(0.02 + 0.01 * noise());
    pos.longitudeAccuracy = (float)(0.02 + 0.01 * noise());
    pos.altitudeAccuracy = fix % 50 == 17 ? 9999.0f : (float)(0.04 + 0.01 * noise());
    SEND(GPS1_POS, GnssPos, pos);
}

static void send_utc(uint32_t stamp, long second, int64_t utc_ns)
{
    SbgEComLogUtc utc;
    sbgEComLogUtcZeroInit(&utc);
    utc.timeStamp = stamp;
    sbgEComLogUtcSetHasClockInput(&utc, second >= 5);
    sbgEComLogUtcSetClockState(&utc, second < 5    ? SBG_ECOM_CLOCK_STATE_FREE_RUNNING
                                     : second < 30 ? SBG_ECOM_CLOCK_STATE_STEERING
                                                   : SBG_ECOM_CLOCK_STATE_VALID);
    sbgEComLogUtcSetUtcStatus(&utc, second < 10   ? SBG_ECOM_UTC_STATUS_INVALID
                                    : second < 20 ? SBG_ECOM_UTC_STATUS_NO_LEAP_SEC
                                                  : SBG_ECOM_UTC_STATUS_INITIALIZED);
    sbgEComLogUtcTimeSetIsAccurate(&utc, second >= 30);
    int64_t seconds = utc_ns / 1000000000;
    if (second < 20)
        seconds += 2;
    utc.year = 2024;
    utc.month = 2;
    utc.day = (int8_t)(28 + seconds / 86400);
    utc.hour = (int8_t)(seconds / 3600 % 24);
    utc.minute = (int8_t)(seconds / 60 % 60);
    utc.second = (int8_t)(seconds % 60);
    utc.nanoSecond = (int32_t)(utc_ns % 1000000000);
    utc.gpsTimeOfWeek = (uint32_t)(utc_ns / 1000000);
    utc.clkBiasStd = 1e-7f;
    utc.clkSfErrorStd = 1e-8f;
    utc.clkResidualError = (float)(1e-8 * noise());
    SEND(UTC_TIME, Utc, utc);

    SbgEComLogStatus status = {.timeStamp = stamp, .generalStatus = 0x7f};
    SEND(STATUS, Status, status);
}

int main(int count, char **arguments)
{
    if (count != 5)
        fail("make SECONDS short|data file|tcp|udp PATH|PORT");
    long seconds = atol(arguments[1]);
    bool is_short = !strcmp(arguments[2], "short");
    bool is_udp = !strcmp(arguments[3], "udp");
    SbgInterface sink;
    sbgInterfaceZeroInit(&sink);
    if (is_udp) {
        if (sbgInterfaceUdpCreate(&sink, sbgNetworkIpFromString("127.0.0.1"),
                                  (uint32_t)atol(arguments[4]), 0) != SBG_NO_ERROR)
            fail("no UDP");
    } else {
        FILE *file = !strcmp(arguments[3], "tcp") ? accept_one(atoi(arguments[4]))
                                                  : fopen(arguments[4], "wb");
        if (!file)
            fail("the file cannot be made");
        sink.handle = file;
        sink.pWriteFunc = to_file;
        sink.pReadFunc = to_nowhere;
    }
    if (sbgEComProtocolInit(&protocol, &sink) != SBG_NO_ERROR)
        fail("no protocol");

    for (long sample = 0; sample < 200 * seconds; sample++) {
        int64_t utc_ns = START_S * INT64_C(1000000000) + sample * INT64_C(5000000);
        /* The clock of the device is fast by 23e-6, a little more at times. */
        double drift = 23e-6 * 5000.0 * (double)sample + 40.0 * sin(0.001 * (double)sample);
        int64_t device_us = (INT64_C(1) << 32) - ROLL_OVER_S * INT64_C(1000000) + 5000 * sample +
                            llround(drift);
        uint32_t stamp = (uint32_t)device_us;
        send_imu(stamp, sample, is_short);
        if (sample % 4 == 1)
            send_ekf(stamp);
        if (sample % 40 == 2)
            send_gnss(stamp, sample / 40);
        if (sample % 200 == 3)
            send_utc(stamp, sample / 200, utc_ns);
        /* The receiver's buffer holds a few hundred datagrams: sent faster, they would be lost. */
        if (is_udp && sample % 8 == 0) {
            struct timespec pause = {.tv_nsec = 4000000};
            nanosleep(&pause, NULL);
        }
    }
    sbgEComProtocolClose(&protocol);
    if (!is_udp) {
        FILE *file = sink.handle;
        if (fflush(file))
            fail("the rest is not sent");
        if (!strcmp(arguments[3], "tcp")) {
            /* The client closes the connection, as with a sensor. */
            char byte;
            while (read(fileno(file), &byte, 1) > 0)
                ;
        }
        fclose(file);
    } else {
        sbgInterfaceDestroy(&sink);
    }
    return 0;
}
