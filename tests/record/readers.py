"""A recording through the Python packages of MCAP and protobuf: every topic is there as often as foretrace says,
and the numbers of the protobuf topics are those of the raw ones. Exits non-zero with what is wrong."""

import json
import math
import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

NUMBERS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i32": "i", "i64": "q", "f32": "f", "f64": "d"}


def fields(schema: bytes) -> dict[str, tuple[int, str]]:
    """Name to offset and struct format of the fields that are numbers, from the table of a raw topic."""
    table = {}
    for line in schema.decode().splitlines()[1:]:
        name, offset, _, kind = line.split()
        number, _, count = kind.partition("*")
        if number in NUMBERS:
            table[name] = (int(offset), f"<{count or 1}{NUMBERS[number]}")
    return table


def main() -> int:
    path, info, report = sys.argv[1:4]
    wanted = json.load(open(info, encoding="utf-8"))["topics"]
    told = json.load(open(report, encoding="utf-8"))
    problems = []

    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        statistics = reader.get_summary().statistics
        counts = {
            reader.get_summary().channels[channel].topic: count
            for channel, count in statistics.channel_message_counts.items()
        }
        if counts != wanted:
            problems.append(f"index counts {counts}, foretrace {wanted}")
        raw, people, frames, lost, lines = {}, {}, 0, None, []
        for schema, channel, message, decoded in reader.iter_decoded_messages(
            topics=["/tick", "/tf", "/log", "/recorder"]
        ):
            if channel.topic == "/tick":
                people[decoded.tick] = decoded
            elif channel.topic == "/tf":
                frames += 1
                if decoded.parent_frame_id != "paper" or decoded.rotation.w != 1.0:
                    problems.append(f"frame {decoded}")
            elif channel.topic == "/log":
                lines.append(decoded)
            else:
                lost = decoded
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=["/raw/tick"]):
            table = fields(schema.data)
            take = lambda name: struct.unpack_from(table[name][1], message.data, table[name][0])
            raw[take("tick")[0]] = (take("q"), take("trust")[0], take("tool_m"), take("release_ns")[0])

    if set(raw) != set(people):
        problems.append(f"{len(raw)} raw ticks, {len(people)} for people")
    for tick, (q, trust, tool, release) in raw.items():
        seen = people.get(tick)
        if seen is None:
            continue
        same = [tuple(seen.q_rad) == q, seen.trust == trust, tuple(seen.tool_m) == tool, seen.release_ns == release]
        if not all(same):
            problems.append(f"tick {tick}: {same}")
            break
    if not any(message.mode == "following" for message in people.values()):
        problems.append("the arm never followed")
    if not any(math.isfinite(message.pen_age_ms) for message in people.values()):
        problems.append("the pen's age is never known")
    if frames != 3 * len(people):
        problems.append(f"{frames} frames for {len(people)} ticks")
    order = [people[tick].mode for tick in sorted(people)]
    changes = sum(before != after for before, after in zip(order, order[1:]))
    modes = [line.message for line in lines if line.message.startswith(("mode ", "stopped: ", "fault: "))]
    if len(modes) != changes or not changes:
        problems.append(f"{changes} changes of mode, /log tells {modes}")
    if any(line.Level.Name(line.level) not in ("DEBUG", "INFO", "WARNING", "ERROR") for line in lines):
        problems.append("a line of /log has no level")
    if lost is None or lost.queue_lost != told["queue_lost"]:
        problems.append(f"/recorder {lost}, report {told}")

    for problem in problems:
        print(f"broken: {problem}")
    if not problems:
        print(f"ok: {len(people)} ticks, {frames} frames, {len(lines)} lines, {sum(counts.values())} messages read by mcap and protobuf")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
