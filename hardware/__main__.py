"""`python -m hardware`: record, replay, check and assemble, from the command line."""

from __future__ import annotations

import argparse
import signal
import sys
import time

from tactilenlp.common.validation import check_range
from tactilenlp.errors import TactileError

from .assemble import COMPLETE, RATE, SHARES, assemble, examine
from .bench import Bench
from .bus_files import FORMATS
from .errors import LimitError, RigError
from .recording import Recording
from .replay import Replay
from .rig import Rig
from .tape import Tape

ABOUT = """\
Record a robot with tactile fingers, and turn the record into measurements.

    python -m hardware record rig.json touches/      listen until Ctrl-C
    python -m hardware check touches/                say how complete it is
    python -m hardware assemble touches/ touches.npz
    python -m hardware replay touches/ --rig r.json  send it again, without a robot

rig.json describes fingers and wires; hardware/README.md has an example.
"""
RECORD = """\
Listen to a robot and write all frames, bytes and pictures with their times to a new
folder, until --seconds have passed, Ctrl-C or `kill`.  Returns 1 if a wire is silent
for longer than --patience; all data received so far are then on the disk.  Faults of
boards and error frames do not end it: they are printed at the end.

    python -m hardware record rig.json touches/ --seconds 60
"""
REPLAY = """\
Send a recording again at the recorded times: CAN frames on buses, serial bytes on
pseudo-terminals.  Writes the rig file that describes these wires.

    python -m hardware replay touches/ --rig replayed.json
    python -m hardware replay touches/ --rig r.json --interface socketcan
"""
CHECK = """\
Print for every stream the number of samples, their rate and jitter, and how many are
missing, and for every finger the share of valid samples of the grid.  Returns 1 if that
share is below --complete.

    python -m hardware check touches/
"""
ASSEMBLE = """\
Sample all streams on one grid and write tactilenlp.Measurements.  Missing samples are
marked as not valid, never as no contact; too many missing samples are an error.

    python -m hardware assemble touches/ touches.npz
"""
FOREVER = 1e9  # [s]
VIRTUAL = "virtual"  # the interface of python-can within one process
TICK = 0.005  # [s] between two readings of the wires


def main(arguments: list[str] | None = None) -> int:
    """Run a command; return 0, or 1 after an error, which is printed."""
    options = _parser().parse_args(arguments)
    try:
        return options.do(options)
    except TactileError as bad:
        print(f"{type(bad).__name__}: {bad}", file=sys.stderr)
        return 1


def _record(options: argparse.Namespace) -> int:
    check_range(
        "--seconds", min(options.seconds, FOREVER), 0.0, FOREVER, "s", LimitError
    )
    rig = Rig.load(options.rig)
    began = time.monotonic()
    with (
        Tape(options.folder, rig, bus=options.bus) as tape,
        Bench(rig, tape=tape, listen_only=not options.ask, touches=False) as bench,
    ):
        try:
            for board in bench.boards if options.ask else ():
                board.ask()
            print(f"Listening to {', '.join(tape.counts)}.", flush=True)
            while time.monotonic() - began < options.seconds:
                time.sleep(TICK)
                bench.poll()
                bench.check_heard(options.patience)
        except KeyboardInterrupt:
            print("stopped by hand", file=sys.stderr)
    for stream, count in tape.counts.items():
        print(f"{stream}: {count}")
    for board in bench.boards:
        if board.errors or board.broken or board.faults:
            faults = ", ".join(sorted(fault.name for fault in board.faults)) or "none"
            counts = f"error frames {board.errors}, broken frames {board.broken}"
            print(f"{board.name}: {counts}, faults {faults}")
    print(f"Recorded {time.monotonic() - began:.1f} s to {options.folder}.")
    return 0


def _check(options: argparse.Namespace) -> int:
    recording = Recording(options.folder)
    check_range("--complete", options.complete, *SHARES, "", LimitError)
    report = examine(recording.fingers(), options.rate)
    print(report)
    good = min(report.valid.values()) >= options.complete
    ended = "as it should" if recording.complete else "with an error"
    print(
        f"The recording ended {ended} and is {'' if good else 'not '}complete enough."
    )
    return 0 if good else 1


def _assemble(options: argparse.Namespace) -> int:
    fingers = Recording(options.folder).fingers()
    data = assemble(
        fingers, options.rate, complete=options.complete, nearest=options.nearest
    )
    data.save(options.file)
    print(f"Wrote {options.file}: {data.samples} samples, {data.fingers} fingers.")
    return 0


def _replay(options: argparse.Namespace) -> int:
    check_range("--wait", options.wait, 0.0, 3600.0, "s", LimitError)
    config = None
    if options.interface == VIRTUAL:
        raise RigError(
            "no other process hears a virtual bus", where="--interface", got=VIRTUAL,
            expected="an interface that other processes can open",
            next="leave it out (UDP multicast), or use Replay within your program",
        )  # fmt: skip
    if options.interface:

        def config(number: int) -> dict:
            channel = options.channel.replace("{}", str(number - 1))
            return {"interface": options.interface, "channel": channel}

    with Replay(Recording(options.folder), config) as replay:
        replay.rig.save(options.rig)
        print(f"Listen to {options.rig}; sending in {options.wait:g} s.", flush=True)
        time.sleep(options.wait)
        count = replay.run(options.speed)
    print(f"Sent {count} frames and chunks.")
    return 0


class _Help(
    argparse.RawDescriptionHelpFormatter, argparse.ArgumentDefaultsHelpFormatter
):
    """Keep the lines of a description, and print the defaults of options."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m hardware",
        description=ABOUT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_subparsers(required=True, metavar="record|replay|check|assemble")

    def command_of(name: str, help: str, description: str) -> argparse.ArgumentParser:
        return add.add_parser(
            name, help=help, description=description, formatter_class=_Help
        )

    _record_options(command_of("record", "listen to a robot, into a folder", RECORD))
    _replay_options(command_of("replay", "send a recording out on wires", REPLAY))
    check = command_of("check", "say how complete a recording is", CHECK)
    turn = command_of("assemble", "write a recording as measurements (.npz)", ASSEMBLE)
    for command, do in ((check, _check), (turn, _assemble)):
        command.set_defaults(do=do)
        command.add_argument("folder", help="a recording")
        rate, share = "[Hz] of the grid", "least share of valid samples"
        command.add_argument("--rate", type=float, default=RATE, help=rate)
        command.add_argument("--complete", type=float, default=COMPLETE, help=share)
    turn.add_argument("file", help=".npz for tactilenlp.Measurements.load")
    nearest = "take the nearest touch, not the newest before"
    turn.add_argument("--nearest", action="store_true", help=nearest)
    return parser


def _record_options(record: argparse.ArgumentParser) -> None:
    record.set_defaults(do=_record)
    record.add_argument("rig", help="JSON file that describes the robot")
    record.add_argument("folder", help="new folder for the recording")
    forever = float("inf")
    record.add_argument("--seconds", type=float, default=forever, help="then stop")
    record.add_argument("--bus", choices=FORMATS, default="blf", help="format for CAN")
    record.add_argument(
        "--ask",
        action="store_true",
        help="tell the boards to send what they measure (no motor is enabled); without "
        "it nothing is sent, and the program that commands the robot must have done so",
    )
    patience = "[s] of silence that end it (of a board's status 3 s at least)"
    record.add_argument("--patience", type=float, default=3.0, help=patience)


def _replay_options(replay: argparse.ArgumentParser) -> None:
    replay.set_defaults(do=_replay)
    replay.add_argument("folder", help="a recording")
    replay.add_argument("--rig", required=True, help="JSON file to write: new wires")
    replay.add_argument("--speed", type=float, default=1.0, help="2: twice as fast")
    replay.add_argument("--wait", type=float, default=2.0, help="[s] before it begins")
    interface = "of python-can; without it UDP multicast"
    replay.add_argument("--interface", default="", help=interface)
    channel = "{} is the number of the bus, from 0"
    replay.add_argument("--channel", default="vcan{}", help=channel)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # `kill` is a Ctrl-C
    sys.exit(main())
