"""Checks the simulated instrument and our client against geocompy (PyPI, 1.0.0).

    python geocompy_check.py SIMULATED TRACK      live checks; prints a summary, exits with 1 at a difference
    python geocompy_check.py --fixtures FOLDER    writes the lines that geocompy sends
"""
import os, pty, re, socket, subprocess, sys, threading, time, tty, types, math

import geocompy.geo as geo
from geocompy.communication import Connection, crc16_bytewise, open_serial, open_socket
from geocompy.data import Angle, Byte
from geocompy.geo.gctypes import GeoComCode, rpcnames

geo.sleep = lambda seconds: None
CHECKS = 0


def check(what, found, expected=True):
    global CHECKS
    CHECKS += 1
    if found != expected:
        print(f"FAILED {what}: found {found!r}, expected {expected!r}")
        sys.exit(1)


class Canned(Connection):
    """A connection that stores the lines sent and answers with one given line."""
    def __init__(self, answer=None):
        self.sent, self.answer = [], answer
    def exchange(self, cmd):
        self.sent.append(cmd)
        if self.answer is not None:
            return self.answer
        transaction = cmd.split(":")[0].split(",")[2]
        return f"%R1P,0,{transaction}:0"
    def send(self, message): pass
    def is_open(self): return True
    def close(self): pass
    def reset(self): pass
    send_binary = receive_binary = receive = exchange_binary = None


def canned(checksum=False):
    conn = Canned()
    tps = geo.GeoCom(conn, checksum=checksum)
    tps.precision = 15
    conn.sent.clear()
    return tps, conn


def value(text):
    return float(text) if "." in text else int(text)


# The call of geocompy that sends the same request, from its parameters.
SAME = {
    0: lambda t, p: t.com.nullprocess(),
    107: lambda t, p: t.com.set_double_precision(*p),
    108: lambda t, p: t.com.get_double_precision(),
    110: lambda t, p: t.com.get_geocom_version(),
    2008: lambda t, p: t.tmc.do_measurement(geo.tmc.Measurement(p[0]), geo.tmc.Inclination(p[1])),
    2020: lambda t, p: t.tmc.set_edm_mode_v2(geo.tmc.EDMModeV2(p[0])),
    2021: lambda t, p: t.tmc.get_edm_mode_v2(),
    2082: lambda t, p: t.tmc.get_coordinate(p[0] / 1000, geo.tmc.Inclination(p[1])),
    2107: lambda t, p: t.tmc.get_angle(geo.tmc.Inclination(p[0])),
    2108: lambda t, p: t.tmc.get_simple_measurement(p[0] / 1000, geo.tmc.Inclination(p[1])),
    2117: lambda t, p: t.tmc.quick_distance(),
    2167: lambda t, p: t.tmc.get_complete_measurement(p[0] / 1000, geo.tmc.Inclination(p[1])),
    5003: lambda t, p: t.csv.get_serial_number(),
    5004: lambda t, p: t.csv.get_instrument_name(),
    5034: lambda t, p: t.csv.get_firmware_version(),
    5039: lambda t, p: t.csv.check_power(),
    6021: lambda t, p: t.mot.get_lockon_status(),
    9013: lambda t, p: t.aut.lock_in(),
    9037: lambda t, p: t.aut.fine_adjust(p[0], p[1]),
    9051: lambda t, p: t.aut.powersearch_next(geo.aut.Turn(p[0]), bool(p[1])),
    17008: lambda t, p: t.bap.set_prism_type(geo.bap.Prism(p[0])),
    17009: lambda t, p: t.bap.get_prism_type(),
    17018: lambda t, p: t.bap.get_measurement_program(),
    17019: lambda t, p: t.bap.set_measurement_program(geo.bap.UserProgram(p[0])),
    18007: lambda t, p: t.aus.switch_user_lock(bool(p[0])),
    18008: lambda t, p: t.aus.get_user_lock_state(),
}
EXAMPLES = {
    107: [15], 2008: [1, 1], 2020: [9], 2082: [0, 1], 2107: [1], 2108: [0, 1], 2167: [0, 1],
    9037: [0.1, 0.0834], 9051: [1, 1], 17008: [7], 17019: [10], 18007: [1],
}


def fixtures(folder):
    lines = []
    for checksum in (False, True):
        tps, conn = canned(checksum)
        for rpc, call in SAME.items():
            call(tps, EXAMPLES.get(rpc, []))
        tps.request(5005, ["a name"])
        tps.request(5007, [2026, Byte(11), Byte(0x2f)])
        lines += conn.sent
    with open(os.path.join(folder, "requests.txt"), "w") as file:
        file.write("# Requests as geocompy 1.0.0 sends them, without and with checksum.\n")
        file.write("\n".join(lines) + "\n")


def session(tps):
    """Checks that geocompy works with the simulated instrument; returns the number of distances."""
    ok = GeoComCode.OK
    check("name", tps.csv.get_instrument_name().params, "SIMULATED TS16")
    check("number", tps.csv.get_serial_number().params, 3201407)
    power = tps.csv.check_power().params
    check("battery", (power[0], power[1].name), (87, "INTERNAL"))
    check("decimals", tps.com.get_double_precision().params, 15)
    check("unknown procedure", tps.bmm.beep_normal().error, GeoComCode.COM_PROC_UNAVAIL)
    check("lock needs lock mode", tps.aut.lock_in().error, GeoComCode.AUT_NOT_ENABLED)
    check("lock mode", tps.aus.switch_user_lock(True).error, ok)
    check("lock mode is on", tps.aus.get_user_lock_state().params, True)
    check("fine adjust", tps.aut.fine_adjust(0.1, 0.1).error, ok)
    check("lock in", tps.aut.lock_in().error, ok)
    check("lock status", tps.mot.get_lockon_status().params.name, "LOCK")
    check("prism", tps.bap.set_prism_type("MINI360").error, ok)
    check("prism read", tps.bap.get_prism_type().params.name, "MINI360")
    check("program", tps.bap.set_measurement_program("CONT_REF_FAST").error, ok)
    check("program read", tps.bap.get_measurement_program().params.name, "CONT_REF_FAST")
    check("EDM mode", tps.tmc.set_edm_mode_v2("CONT_FAST").error, ok)
    check("EDM mode read", tps.tmc.get_edm_mode_v2().params.name, "CONT_FAST")
    check("bad EDM mode", tps.request(2020, [99]).error, GeoComCode.IVPARAM)
    before = tps.tmc.get_complete_measurement(0)
    check("no distance yet", before.error, GeoComCode.TMC_ANGLE_OK)
    check("eight values", len(before.params), 8)
    check("start", tps.tmc.do_measurement().error, ok)
    distances = 0
    for _ in range(10):
        full = tps.tmc.get_complete_measurement(1)
        check("full measurement", full.error, ok)
        hz, v, acc, cross, length, inc_acc, distance, time_ms = full.params
        e, n, u = 2.0 + 0.1e-3 * time_ms, 20.0, 1.0
        check("distance", abs(distance - math.sqrt(e * e + n * n + u * u)) < 1e-4)
        # The angles are up to one interval newer than the distance.
        check("Hz", abs(float(hz) - math.atan2(e, n)) < 2e-3)
        check("V", abs(float(v) - math.atan2(math.hypot(e, n), u)) < 2e-3)
        distances += 1
    angles = [tps.tmc.get_complete_measurement(0) for _ in range(20)]
    check("angles between", sum(a.error == GeoComCode.TMC_ANGLE_OK for a in angles) > 10)
    check("angle", len(tps.tmc.get_angle().params), 2)
    check("simple", len(tps.tmc.get_simple_measurement(1).params), 3)
    check("quick", tps.tmc.quick_distance().error, ok)
    coordinate = tps.tmc.get_coordinate(1)
    check("coordinate", abs(coordinate.params[0].y - 20.0) < 1e-9)
    check("stop", tps.tmc.do_measurement("CLEAR").error, ok)
    check("off", tps.aus.switch_user_lock(False).error, ok)
    return distances


def simulated(program):
    process = subprocess.Popen([program, "tcp", "127.0.0.1:0"], stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True)
    host, port = process.stdout.readline().strip().rsplit(":", 1)
    return process, host, int(port)


def over_tcp(program):
    for checksum in (False, True):
        process, host, port = simulated(program)
        with open_socket(host, port, "tcp", timeout=5) as conn:
            seen = []
            exchange = conn.exchange
            def keep(cmd):
                answer = exchange(cmd)
                seen.append((cmd, answer))
                return answer
            conn.exchange = keep
            distances = session(geo.GeoCom(conn, checksum=checksum))
            with_sum = sum(a.split(":")[0].count(",") == 3 for _, a in seen)
            if checksum:
                check("checksums in replies", with_sum >= len(seen) - 1)
            print(f"tcp, checksum={checksum}: {len(seen)} exchanges, {with_sum} replies with "
                  f"checksum, {distances} full measurements")
        process.stdin.close()
        process.wait(5)


def over_pty(program):
    master, slave = pty.openpty()
    tty.setraw(slave)
    process = subprocess.Popen([program, "stdio"], stdin=master, stdout=master)
    with open_serial(os.ttyname(slave), speed=115200, timeout=5) as conn:
        distances = session(geo.GeoCom(conn, checksum=True))
    print(f"pty and pyserial, checksum=True: {distances} full measurements")
    process.terminate()
    process.wait(5)


def pump(source, sink, log):
    rest = b""
    while True:
        try:
            data = source.recv(4096)
        except OSError:
            data = b""
        if not data:
            try:
                sink.shutdown(socket.SHUT_WR)
            except OSError:
                pass
            return
        rest += data
        while b"\r\n" in rest:
            line, rest = rest.split(b"\r\n", 1)
            log.append(line.decode("ascii"))
        sink.sendall(data)


def client(program, track):
    """Our client talks to the simulated instrument; geocompy reads both sides of the exchange."""
    for checksum in (False, True):
        process, host, port = simulated(program)
        listener = socket.create_server(("127.0.0.1", 0))
        requests, replies = [], []
        def serve():
            near = listener.accept()[0]
            far = socket.create_connection((host, port))
            there = threading.Thread(target=pump, args=(near, far, requests))
            there.start()
            pump(far, near, replies)
            there.join()
        server = threading.Thread(target=serve)
        server.start()
        arguments = [track, f"127.0.0.1:{listener.getsockname()[1]}", "3"]
        ran = subprocess.run(arguments + ["checksum"] * checksum, capture_output=True, text=True)
        check("our client ran", (ran.returncode, ran.stderr), (0, ""))
        server.join(5)
        process.stdin.close()
        check("a reply to each request", len(replies), len(requests))
        procedures, full = set(), 0
        for line, reply in zip(requests, replies):
            header, body = line.lstrip("\n").split(":", 1)
            fields = header.split(",")
            rpc, transaction = int(fields[1]), int(fields[2])
            tps, conn = CANNED[len(fields) == 4]
            conn.sent.clear()
            tps.transaction_counter, conn.answer = transaction, reply
            answer = SAME[rpc](tps, [value(p) for p in body.split(",")] if body else [])
            check(f"{rpcnames[rpc]} is the line of geocompy", conn.sent[0], line)
            check(f"{rpcnames[rpc]} transaction", answer.trans, transaction)
            check(f"{rpcnames[rpc]} is decoded", answer.error in (
                GeoComCode.OK, GeoComCode.TMC_ANGLE_OK))
            if rpc == 2167:
                check("eight values", len(answer.params), 8)
                full += answer.error == GeoComCode.OK
            procedures.add(rpcnames[rpc])
        check("distances at 7 Hz", full >= 18)
        print(f"our client, checksum={checksum}: {len(requests)} requests equal byte for byte, "
              f"{len(procedures)} procedures, {full} with distance")


if sys.argv[1] == "--fixtures":
    fixtures(sys.argv[2])
else:
    CANNED = {checksum: canned(checksum) for checksum in (False, True)}
    over_tcp(sys.argv[1])
    over_pty(sys.argv[1])
    client(sys.argv[1], sys.argv[2])
    print(f"{CHECKS} checks agree with geocompy")
