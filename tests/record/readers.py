"""A recording through the Python packages of MCAP and protobuf: every topic is there as often as foretrace says,
the numbers of the protobuf topics are those of the raw ones, and the arm that is drawn holds the tool where the
tick records measured it. Exits non-zero with what is wrong."""

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


def turned(q, v):
    """The vector `v` turned by the unit quaternion `q`."""
    x, y, z, w = q.x, q.y, q.z, q.w
    cross = lambda a, b: (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    twice = [2 * c for c in cross((x, y, z), v)]
    return tuple(a + w * b + c for a, b, c in zip(v, twice, cross((x, y, z), twice)))


def placed(frame, v):
    """The point `v` of a frame in its parent."""
    at = frame.translation
    return tuple(a + b for a, b in zip(turned(frame.rotation, v), (at.x, at.y, at.z)))


def drawn(scenes, around, ticks) -> list[str]:
    """What is wrong with the scene, and with the frames that it hangs in, by their times."""
    problems = []
    if len(scenes) != 1:
        return [f"{len(scenes)} scenes for settings that never changed"]
    entities = {entity.id: entity for entity in scenes[0].entities}
    newest = list(around.values())[-1] if around else {}
    for entity in entities.values():
        if entity.frame_id != "base" and entity.frame_id not in newest:
            problems.append(f"{entity.id} hangs in {entity.frame_id}, which has no place")
        solids = [*entity.cubes, *entity.spheres, *entity.cylinders]
        if not solids or any(min(s.size.x, s.size.y, s.size.z) <= 0 or s.color.a <= 0 for s in solids):
            problems.append(f"{entity.id} cannot be seen")
        if any((c.bottom_scale, c.top_scale) != (1.0, 1.0) for c in entity.cylinders):
            problems.append(f"{entity.id} has a cone")
    if not {"paper", "pen"} <= set(entities) or sum(id.startswith("arm ") for id in entities) < 4:
        problems.append(f"no whole scene: {sorted(entities)}")
        return problems
    # While the arm rests, the drawn tip is where the command put the tool.
    tip, best = entities["pen"].spheres[-1].pose.position, math.inf
    for time, frames in around.items():
        tick = ticks.get(time)
        if tick is not None and {"paper", "arm_6"} <= set(frames):
            at = placed(frames["arm_6"], (tip.x, tip.y, tip.z))
            tool = placed(frames["paper"], tuple(tick.tool_m))
            best = min(best, math.dist(at, tool))
    if not best < 1e-4:
        problems.append(f"the drawn tip never comes nearer than {best} m to the tool")
    return problems


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
        raw, people, frames, lost, lines, scenes, around, times, paths = {}, {}, 0, None, [], [], {}, {}, {}
        for schema, channel, message, decoded in reader.iter_decoded_messages(
            topics=["/tick", "/tf", "/log", "/recorder", "/scene", "/preview"]
        ):
            if channel.topic == "/tick":
                people[decoded.tick] = times[message.log_time] = decoded
            elif channel.topic == "/tf" and decoded.parent_frame_id == "base":
                around.setdefault(message.log_time, {})[decoded.child_frame_id] = decoded
            elif channel.topic == "/tf":
                frames += 1
                if decoded.parent_frame_id != "paper" or decoded.rotation.w != 1.0:
                    problems.append(f"frame {decoded}")
            elif channel.topic == "/scene":
                scenes.append(decoded)
            elif channel.topic == "/preview":
                paths[message.log_time] = [(p.x, p.y) for e in decoded.entities for line in e.lines for p in line.points]
            elif channel.topic == "/log":
                lines.append(decoded)
            else:
                lost = decoded
    previewed = 0
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=["/raw/tick"]):
            table = fields(schema.data)
            take = lambda name: struct.unpack_from(table[name][1], message.data, table[name][0])
            raw[take("tick")[0]] = (take("q"), take("trust")[0], take("tool_m"), take("release_ns")[0])
            if message.log_time in paths:
                numbers = take("path_m")[: 2 * take("path_points")[0]]
                if paths.pop(message.log_time) != list(zip(numbers[::2], numbers[1::2])):
                    problems.append(f"tick {take('tick')[0]}: another path than that of its record")
                previewed += len(numbers) == 20

    if paths or previewed < 20:
        problems.append(f"{previewed} previewed paths of ten points, {len(paths)} without a record")
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
    problems += drawn(scenes, around, times)
    seconds = len(people) and (max(times) - min(times)) * 1e-9
    if not 15 * seconds < len(around) < 21 * seconds + 1:
        problems.append(f"the arm was placed {len(around)} times in {seconds:.1f} s")
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
        print(f"ok: {len(people)} ticks, {frames} frames, {len(around)} times the arm, {len(lines)} lines, {sum(counts.values())} messages read by mcap and protobuf")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
