"""A flight recorder's trace through Perfetto's own protobuf: every event lies on a track that is described, and every
slice that begins ends. Exits non-zero with what is wrong."""

import sys

from perfetto.protos.perfetto.trace.perfetto_trace_pb2 import Trace

BEGIN, END, INSTANT, COUNTER = 1, 2, 3, 4


def main() -> int:
    trace = Trace()
    with open(sys.argv[1], "rb") as file:
        trace.ParseFromString(file.read())
    tracks, depth, counts, problems = {}, {}, {}, []
    for packet in trace.packet:
        if packet.HasField("track_descriptor"):
            tracks[packet.track_descriptor.uuid] = packet.track_descriptor.name
        elif packet.HasField("track_event"):
            event = packet.track_event
            name = tracks.get(event.track_uuid)
            if name is None:
                problems.append(f"an event on track {event.track_uuid}, which is not described")
                break
            counts[name, event.type] = counts.get((name, event.type), 0) + 1
            depth[name] = depth.get(name, 0) + {BEGIN: 1, END: -1}.get(event.type, 0)
            if depth[name] < 0 or event.type == BEGIN and not event.name:
                problems.append(f"{name}: a slice without beginning or name")
                break
    problems += [f"{name}: {open_} slices do not end" for name, open_ in depth.items() if open_]
    wanted = {("rt thread: stages of the tick", BEGIN), ("rt thread: wake-up", BEGIN), ("trust", COUNTER)}
    wanted |= {("arm: joint states", INSTANT), ("pen: samples", INSTANT)}
    if wanted - set(counts):
        problems.append(f"too little in it: {counts}")
    for problem in problems:
        print(f"broken: {problem}")
    if not problems:
        print(f"ok: {len(trace.packet)} packets on {len(tracks)} tracks read by Perfetto's protobuf")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
