#!/usr/bin/env python3
"""Drives the firmware emulators with other people's clients.

    tests/strangers.py [--twinrig PATH] [--only NAME ...]

Makes a virtual environment (in a temporary folder, or in STRANGERS_VENV), installs the clients from
PyPI, starts `twinrig emulate PROTOCOL --link PATH --speed 4` for each and performs homing, moves,
reads and refusals. Exits 0 when every client was satisfied, 1 when one was not, and 0 with a message
when the package registry cannot be reached.

Known bugs of the clients, which the checks go around: pydobot computes the sums of ids 0 and 1 wrongly
and reads only what has come after 100 ms; dynamixel-sdk does no byte stuffing.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PACKAGES = ["pyserial", "zaber-motion", "thorlabs-apt-device", "dynamixel-sdk", "feetech-servo-sdk", "pydobot"]
WITHOUT_DEPENDENCIES = ["printrun"]


def expect(what, condition):
    if not condition:
        raise AssertionError(what)


def wait_for(what, condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition():
        expect(f"{what} within {seconds} s", time.monotonic() < end)
        time.sleep(0.02)


def settled(read, at):
    """Whether a servo's register reads 0; on a busy machine these clients give up early and read 0 too."""
    value, result, _ = read(at)
    return result == 0 and value == 0


def printrun(port):
    """printcore streams numbered lines with checksums and understands resends."""
    from printrun import gcoder
    from printrun.printcore import printcore

    heard = []
    core = printcore()
    core.recvcb = lambda line: heard.append(line.strip())
    core.connect(port, 115200)
    # A pseudo-terminal has no DTR, so the printer does not greet; printcore asks with M105.
    wait_for("printcore online", lambda: core.online)
    core.send_now("M115")
    wait_for("M115", lambda: any("FIRMWARE_NAME:Marlin" in line for line in heard))
    # A long travel, a barrier, a dwell with busy lines, and a position that must be the last one.
    lines = ["G21", "G90", "G28 X Y", "G1 X20 Y10 F6000", "G4 P200", "G1 X30 F3000", "M400", "M114"]
    core.startprint(gcoder.LightGCode(lines))
    wait_for("the end of the print", lambda: not core.printing)
    wait_for("M114", lambda: any(line.startswith("X:30.00 Y:10.00") for line in heard))
    counts = [line for line in heard if line.startswith("X:30.00")][-1]
    expect(f"steps of 30 mm in {counts}", "Count X:2400 Y:800" in counts)
    core.disconnect()


def zaber(port):
    """The vendor's own client checks the LRC and the message id of every reply."""
    from zaber_motion.ascii import Connection
    from zaber_motion.exceptions import CommandFailedException

    with Connection.open_serial_port(port) as connection:
        reply = connection.generic_command("", device=1)
        expect("not referenced at power-up", reply.warning_flag == "WR")
        device = connection.get_device(1)
        axis = device.get_axis(1)
        axis.home()
        expect("home is 0", axis.get_position() == 0)
        axis.move_absolute(10000)
        expect("move_absolute", axis.get_position() == 10000)
        axis.move_relative(-4000)
        expect("move_relative", axis.get_position() == 6000)
        axis.move_absolute(200000, wait_until_idle=False)
        expect("busy", axis.is_busy())
        axis.stop()
        stopped = axis.get_position()
        expect(f"stopped underway at {stopped}", 6000 <= stopped < 200000)
        expect("device id", device.settings.get("deviceid") == 50081)
        try:
            axis.move_absolute(10**6)
        except CommandFailedException as refusal:
            expect("BADDATA", "BADDATA" in str(refusal))
        else:
            raise AssertionError("a move beyond the limit was not refused")


def thorlabs(port):
    """Polls status, homes at start, and keeps the stage's parameters."""
    from thorlabs_apt_device import KDC101

    device = KDC101(serial_port=port, serial_number=None, home=True)
    wait_for("homed", lambda: device.status["homed"] and not device.status["homing"])
    device.move_absolute(172775)
    wait_for("5 mm", lambda: abs(device.status["position"] - 172775) <= 1)
    device.move_relative(-17277)
    wait_for("4.5 mm", lambda: abs(device.status["position"] - 155498) <= 1)
    device.move_absolute(1500000)
    time.sleep(0.5)
    device.stop(immediate=False)
    wait_for("rest", lambda: not (device.status["moving_forward"] or device.status["moving_reverse"]))
    expect("stopped underway", 155498 < device.status["position"] < 1500000)
    device.close()


def dynamixel(port):
    """Reads and writes registers; the CRC of every reply is checked."""
    from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

    handler, packets = PortHandler(port), PacketHandler(2.0)
    expect("open", handler.openPort() and handler.setBaudRate(57600))
    model, result, error = packets.ping(handler, 1)
    expect(f"ping: {model} {result} {error}", (model, result, error) == (1200, COMM_SUCCESS, 0))
    found, result = packets.broadcastPing(handler)
    expect(f"broadcast ping: {found}", sorted(found) == [1, 2])
    packets.write1ByteTxRx(handler, 1, 64, 1)
    packets.write4ByteTxRx(handler, 1, 116, 2048)
    wait_for("rest", lambda: settled(lambda at: packets.read1ByteTxRx(handler, 1, at), 122))
    wait_for("goal reached", lambda: packets.read4ByteTxRx(handler, 1, 132)[0] == 2048, 5)
    _, error = packets.write4ByteTxRx(handler, 1, 116, 5000)
    expect("a goal beyond the range is refused", error != 0)
    _, result, _ = packets.ping(handler, 9)
    expect("nobody has id 9", result != COMM_SUCCESS)
    handler.closePort()


def feetech(port):
    """The same for the frames of protocol 1."""
    from scservo_sdk import COMM_SUCCESS, PacketHandler, PortHandler

    handler, packets = PortHandler(port), PacketHandler(0)
    expect("open", handler.openPort() and handler.setBaudRate(1000000))
    model, result, error = packets.ping(handler, 1)
    expect(f"ping: {model} {result} {error}", (model, result, error) == (777, COMM_SUCCESS, 0))
    packets.write1ByteTxRx(handler, 1, 40, 1)
    packets.write2ByteTxRx(handler, 1, 42, 2048)
    wait_for("rest", lambda: settled(lambda at: packets.read1ByteTxRx(handler, 1, at), 66))
    wait_for("goal reached", lambda: packets.read2ByteTxRx(handler, 1, 56)[0] == 2048, 5)
    handler.closePort()


def dobot(port):
    """Starts the queue, sets parameters, moves and waits for the index."""
    from pydobot import Dobot

    device = Dobot(port=port, verbose=False)
    device.move_to(200, 0, 50, 0, wait=True)
    device.move_to(220, 30, 40, 10, wait=True)
    pose = device.pose()
    expect(f"pose {pose[:4]}", all(abs(a - b) < 0.02 for a, b in zip(pose[:4], (220, 30, 40, 10))))
    device.close()


CLIENTS = {
    "printrun": ("marlin", printrun),
    "zaber-motion": ("zaber_ascii", zaber),
    "thorlabs-apt-device": ("thorlabs_apt", thorlabs),
    "dynamixel-sdk": ("dynamixel2", dynamixel),
    "feetech-servo-sdk": ("feetech_sts", feetech),
    "pydobot": ("dobot_magician", dobot),
}


def environment(folder):
    """Path of a Python that has the clients, or None when they cannot be had."""
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    pip = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    for packages in ([*PACKAGES], ["--no-deps", *WITHOUT_DEPENDENCIES]):
        if subprocess.run([*pip, *packages], timeout=600).returncode != 0:
            return None
    return python


def run_client(name, command, folder):
    """Starts the emulator, runs one client against it in a process of its own."""
    protocol, _ = CLIENTS[name]
    link = folder / f"port-{name}"
    words = [word.format(protocol=protocol, link=link) for word in command]
    emulator = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    try:
        wait_for(f"{link}", link.exists, 20)
        client = [sys.executable, __file__, "--client", name, "--port", str(link)]
        return subprocess.run(client, timeout=120).returncode == 0
    except (AssertionError, subprocess.TimeoutExpired) as failure:
        print(f"{name}: {failure}", file=sys.stderr)
        return False
    finally:
        emulator.terminate()
        emulator.wait(10)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twinrig", default="target/release/twinrig", help="the program")
    parser.add_argument("--emulator", help="another command line, with {protocol} and {link}")
    parser.add_argument("--only", nargs="*", default=list(CLIENTS), choices=list(CLIENTS))
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--client", help=argparse.SUPPRESS)
    parser.add_argument("--port", help=argparse.SUPPRESS)
    options = parser.parse_args()

    if options.client:
        CLIENTS[options.client][1](options.port)
        return 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if not options.inside:
            python = environment(Path(os.environ.get("STRANGERS_VENV", folder / "venv")))
            if python is None:
                print("skipped: the package registry cannot be reached")
                return 0
            return subprocess.run([str(python), *sys.argv, "--inside"]).returncode
        default = [options.twinrig, "emulate", "{protocol}", "--link", "{link}", "--speed", "4"]
        command = options.emulator.split() if options.emulator else default
        results = {name: run_client(name, command, folder) for name in options.only}
    for name, satisfied in results.items():
        print(f"{name}: {'satisfied' if satisfied else 'NOT satisfied'}")
    return 0 if all(results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
