"""How fast frames become samples: generated readers against two other routes, in one run, as ratios.

`python -m tests.bench_decode`: the peers are cantools' own `Message.decode_simple` and the reading of bit
fields at run time, as this project did it before (kept here for that). All three give the same values.
"""

from __future__ import annotations

import struct
import sys
import time
from collections.abc import Callable, Sequence

import cantools
from cantools.database.can import Message

from dsz_daemon.pipeline.bit_fields import bit_field, reader
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Part, Source
from dsz_daemon.pipeline.protection import Checksum, Counter, Protection
from dsz_daemon.pipeline.rate_bound import RateBound
from dsz_daemon.shipped import shipped

FRAMES = 20_000
ROUNDS = 5


def interpreted(message: Message, names: Sequence[str]) -> Callable[[bytes], list[float]]:
    """All of `names` out of a payload, each by its place looked up anew."""
    fields = {name: bit_field(message.get_signal_by_name(name)) for name in names}

    def one(name: str, data: bytes) -> float:
        field = fields[name]
        raw: float = (int.from_bytes(data[field.first_byte : field.end_byte], field.order) >> field.shift) & field.mask
        if field.is_float:
            raw = struct.unpack(">f", int(raw).to_bytes(4, "big"))[0]
        elif field.sign_bit and int(raw) & field.sign_bit:
            raw -= field.mask + 1
        return raw * field.scale + field.offset

    return lambda data: [one(name, data) for name in names]


def seconds(work: Callable[[], object]) -> float:
    """The best of some rounds: what disturbs only ever makes it longer."""
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def payloads(message: Message) -> list[bytes]:
    """Some payloads whose values are all inside any bound."""
    return [bytes((17 * k + n) % 256 for n in range(message.length)) for k in range(FRAMES)]


def rows() -> list[tuple[str, float]]:
    """(What, microseconds a frame) of the four wheel speeds of one message."""
    database = cantools.database.load_file(shipped("dbc/example_car.dbc"))
    message = database.get_message_by_name("WHEEL_SPEEDS")
    names = [signal.name for signal in message.signals][:4]
    datas = payloads(message)
    frames = [Frame(n * 10_000_000, "can0", message.frame_id, data) for n, data in enumerate(datas)]
    sources = [Source(name, message.name, (Part(name),), 1.0, -1e9, 1e9) for name in names]
    messages = {message.name: message}
    read = [reader(bit_field(message.get_signal_by_name(name))) for name in names]
    by_fields = interpreted(message, names)
    for data in datas[:256]:
        theirs = message.decode_simple(data, decode_choices=False)
        assert [r(data) for r in read] == by_fields(data) == [theirs[name] for name in names]
    bound = RateBound.of(2000.0, 0.5, 1.0)
    protection = Protection(message.name, Counter(names[0]), Checksum("sum8"))

    def decoded(decoder: Decoder) -> None:
        for frame in frames:
            decoder.decode(frame)

    def plainly(one: Callable[[bytes], object]) -> Callable[[], None]:
        def work() -> None:
            for data in datas:
                one(data)

        return work

    timed = {
        "cantools decode_simple": plainly(lambda data: message.decode_simple(data, decode_choices=False)),
        "bit fields interpreted": plainly(by_fields),
        "generated readers": plainly(lambda data: [r(data) for r in read]),
        "Decoder.decode": lambda: decoded(Decoder(sources, messages)),
        "Decoder.decode, rate bound": lambda: decoded(Decoder(sources, messages, rate_bound=bound)),
        "Decoder.decode, rate bound, checksum and counter refused": lambda: decoded(
            Decoder(sources, messages, protections=(protection,), rate_bound=bound)
        ),
    }
    return [(name, seconds(work) / FRAMES * 1e6) for name, work in timed.items()]


def main() -> int:
    """Prints the table."""
    measured = rows()
    peer = dict(measured)["bit fields interpreted"]
    print("| four wheel speeds of one frame | us | x as fast as interpreted |\n|---|---|---|")
    for name, microseconds in measured:
        print(f"| {name} | {microseconds:.2f} | {peer / microseconds:.1f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
