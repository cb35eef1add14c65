#!/usr/bin/env python3
"""Drives our firmware emulators with other people's clients, and other people's firmware with our client.

    tests/strangers.py [--twinrig PATH] [--only NAME ...]

Makes virtual environments (in a temporary folder, or in STRANGERS_VENV and OCTOPRINT_VENV), installs the
strangers from PyPI, and
- starts `twinrig emulate PROTOCOL --link PATH --speed 4` for each client, which performs homing, moves,
  reads and refusals;
- puts OctoPrint's virtual printer behind a pseudo-terminal and runs `twinrig home` and `twinrig move`
  against it, with a lost line and a wrong checksum on the way.
Exits 0 when every stranger was satisfied, 1 when one was not, and 0 with a message when their packages
cannot be installed.

Known bugs of the clients, which the checks go around: pydobot computes the sums of ids 0 and 1 wrongly
and reads only what has come after 100 ms; dynamixel-sdk does no byte stuffing.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

PACKAGES = ["pyserial", "zaber-motion", "thorlabs-apt-device", "dynamixel-sdk", "feetech-servo-sdk", "pydobot"]
WITHOUT_DEPENDENCIES = ["printrun"]
OCTOPRINT = "octoprint"


def expect(what, condition):
    if not condition:
        raise AssertionError(what)


def wait_for(what, condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition():
        expect(f"{what} within {seconds} s", time.monotonic() < end)
        time.sleep(0.02)


def answered(ask):
    """What a servo answers; on a busy machine these clients give up before the answer comes, and ask again."""
    for _ in range(20):
        *value, result, error = ask()
        if result == 0:
            break
    return *value, result, error


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
    model, result, error = answered(lambda: packets.ping(handler, 1))
    expect(f"ping: {model} {result} {error}", (model, result, error) == (1200, COMM_SUCCESS, 0))
    wait_for("a broadcast ping that finds both", lambda: sorted(packets.broadcastPing(handler)[0]) == [1, 2], 10)
    answered(lambda: packets.write1ByteTxRx(handler, 1, 64, 1))
    answered(lambda: packets.write4ByteTxRx(handler, 1, 116, 2048))
    wait_for("rest", lambda: settled(lambda at: packets.read1ByteTxRx(handler, 1, at), 122))
    wait_for("goal reached", lambda: packets.read4ByteTxRx(handler, 1, 132)[0] == 2048, 5)
    _, error = answered(lambda: packets.write4ByteTxRx(handler, 1, 116, 5000))
    expect("a goal beyond the range is refused", error != 0)
    _, result, _ = packets.ping(handler, 9)
    expect("nobody has id 9", result != COMM_SUCCESS)
    handler.closePort()


def feetech(port):
    """The same for the frames of protocol 1."""
    from scservo_sdk import COMM_SUCCESS, PacketHandler, PortHandler

    handler, packets = PortHandler(port), PacketHandler(0)
    expect("open", handler.openPort() and handler.setBaudRate(1000000))
    model, result, error = answered(lambda: packets.ping(handler, 1))
    expect(f"ping: {model} {result} {error}", (model, result, error) == (777, COMM_SUCCESS, 0))
    answered(lambda: packets.write1ByteTxRx(handler, 1, 40, 1))
    answered(lambda: packets.write2ByteTxRx(handler, 1, 42, 2048))
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


def environment(folder, groups, within):
    """Path of a Python that has these packages, or None when they cannot be had within so many seconds."""
    end = time.monotonic() + within
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    pip = [str(python), "-m", "pip", "install", "-q", "--no-compile", "--disable-pip-version-check"]
    for packages in groups:
        try:
            left = max(1.0, end - time.monotonic())
            if subprocess.run([*pip, *packages], timeout=left).returncode != 0:
                return None
        except subprocess.TimeoutExpired:
            return None
    return python


def serve_octoprint(link, folder):
    """OctoPrint's virtual printer behind a pseudo-terminal, until it is terminated."""
    import threading
    import tty

    import octoprint.plugin
    import octoprint.settings
    from octoprint.plugins.virtual_printer import VirtualPrinterPlugin
    from octoprint.plugins.virtual_printer.virtual import VirtualPrinter
    from octoprint.printer.profile import PrinterProfileManager

    octoprint.settings.settings(init=True, basedir=str(folder))
    octoprint.plugin.plugin_manager(init=True, plugin_folders=[], plugin_entry_points=[])
    defaults = VirtualPrinterPlugin().get_settings_defaults()
    # It asks for line 6 again, and finds a wrong checksum in line 9.
    defaults.update(simulated_errors=["6:resend", "9:checksum_mismatch"], sendWait=False, throttle=0.001)
    settings = octoprint.plugin.plugin_settings("virtual_printer", defaults=defaults)
    ours, theirs = os.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    printer = VirtualPrinter(settings, PrinterProfileManager(), data_folder=str(folder), read_timeout=0.2)

    def listen():
        # It takes one line a call, whatever a port would hand over.
        rest = b""
        while True:
            *lines, rest = (rest + os.read(ours, 1024)).split(b"\n")
            for line in lines:
                printer.write(line + b"\n")

    threading.Thread(target=listen, daemon=True).start()
    os.symlink(os.ttyname(theirs), link)
    while True:
        line = printer.readline()
        if line:
            os.write(ours, line.rstrip(b"\r\n") + b"\n")


RIG = """
schema = 1
name = "stranger"
sensor = "gelsight"
[devices.arm]
protocol = "marlin"
port = "{link}"
identity = "Virtual Marlin"
axes.x = {{ wire = "X", kind = "linear", min = 0, max = 200, max_feed = 50, accel = 300, tolerance = 0.02 }}
axes.z = {{ wire = "Z", kind = "linear", min = 0, max = 200, max_feed = 20, accel = 50, tolerance = 0.01 }}
[motion]
x = {{ device = "arm", axis = "x", sign = 1, origin = 100.0 }}
z = {{ device = "arm", axis = "z", sign = 1, origin = 30.0 }}
[camera]
source = "replay"
replay = {{ path = "{images}", repeat = true }}
"""


def run_octoprint(twinrig, python, folder):
    """Homes and moves the stranger's printer, and replays the logs of it."""
    link, rig, logs = folder / "octoprint", folder / "rig.toml", folder / "logs"
    images = Path(__file__).resolve().parent / "data" / "readme"
    rig.write_text(RIG.format(link=link, images=images))
    (folder / "base").mkdir()
    served = [str(python), __file__, "--serve", str(link), "--folder", str(folder / "base")]
    printer = subprocess.Popen(served, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    environ = dict(os.environ, TWINRIG_LOGS=str(logs))

    def ours(*words):
        done = subprocess.run([twinrig, *words], capture_output=True, text=True, timeout=60, env=environ)
        expect(f"twinrig {' '.join(words)}: {done.stderr}", done.returncode == 0)
        return done.stdout

    try:
        wait_for(f"{link}", link.is_symlink, 30)
        ours("home", str(rig))
        for x, z in ((5.5, 12.25), (-3.0, 4.0)):
            place = json.loads(ours("move", str(rig), "--home", "--json", f"--x={x}", f"--z={z}", "--feed", "15"))
            pose = place["pose"]
            expect(f"pose {pose}", abs(pose["x_mm"] - x) < 0.02 and abs(pose["z_mm"] - z) < 0.02)
        written = sorted(logs.glob("*/arm.log"))
        expect("three sessions, three logs", len(written) == 3)
        for log in written:
            ours("replay", str(log))
        resent = [line for log in written for line in log.read_text().splitlines() if "sending again" in line]
        expect("lines were sent again", resent)
        return True
    except (AssertionError, subprocess.TimeoutExpired) as failure:
        print(f"{OCTOPRINT}: {failure}", file=sys.stderr)
        return False
    finally:
        printer.kill()
        printer.wait(10)


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
    names = [*CLIENTS, OCTOPRINT]
    parser.add_argument("--only", nargs="*", default=names, choices=names)
    parser.add_argument("--install-within", type=float, default=900, help="seconds that installing may take")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--client", help=argparse.SUPPRESS)
    parser.add_argument("--port", help=argparse.SUPPRESS)
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    parser.add_argument("--folder", help=argparse.SUPPRESS)
    options = parser.parse_args()

    if options.client:
        CLIENTS[options.client][1](options.port)
        return 0
    if options.serve:
        serve_octoprint(options.serve, options.folder)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        clients = [name for name in options.only if name in CLIENTS]
        if not options.inside:
            satisfied = True
            if clients:
                groups = ([*PACKAGES], ["--no-deps", *WITHOUT_DEPENDENCIES])
                python = environment(Path(os.environ.get("STRANGERS_VENV", folder / "venv")), groups, options.install_within)
                if python is None:
                    print("SKIPPED the clients: their packages could not be installed in time")
                else:
                    words = [word for word in sys.argv if word not in (OCTOPRINT, "--only", *CLIENTS)]
                    words += ["--only", *clients, "--inside"]
                    satisfied = subprocess.run([str(python), *words]).returncode == 0
            if OCTOPRINT in options.only:
                place = Path(os.environ.get("OCTOPRINT_VENV", folder / "octoprint_venv"))
                python = environment(place, ([OCTOPRINT],), options.install_within)
                if python is None:
                    print(f"SKIPPED {OCTOPRINT}: its packages could not be installed in time")
                else:
                    proved = run_octoprint(options.twinrig, python, folder)
                    print(f"{OCTOPRINT}: {'satisfied' if proved else 'NOT satisfied'}")
                    satisfied = satisfied and proved
            return 0 if satisfied else 1
        default = [options.twinrig, "emulate", "{protocol}", "--link", "{link}", "--speed", "4"]
        command = options.emulator.split() if options.emulator else default
        # They mostly wait: two at a time.
        with ThreadPoolExecutor(max_workers=2) as lanes:
            results = dict(zip(clients, lanes.map(lambda name: run_client(name, command, folder), clients)))
        for name in [name for name, satisfied in results.items() if not satisfied]:
            print(f"{name}: not satisfied, perhaps for want of time; once more, alone", flush=True)
            results[name] = run_client(name, command, folder)
    for name, satisfied in results.items():
        print(f"{name}: {'satisfied' if satisfied else 'NOT satisfied'}")
    return 0 if all(results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
