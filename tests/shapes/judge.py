"""Capsules of a preset's arm against the meshes that they stand for; distances of meshes by coal (exact, BVH).

judge.py ARM FOLDER DISTANCES WRITTEN...: ARM is ur5 or ur5e (preset and robot); FOLDER has the wheels (meshes.py); DISTANCES
is the command that prints the daemon's own numbers (config/examples/own_distances.rs); WRITTEN are CSVs of `foretrace lab
closed-loop --ticks`: what the law commands while it writes. POSES (default 20000) random postures, drawn over the joints' whole ranges. Exit code: broken
claims.

What is claimed, of the pairs that the daemon checks:
- no vertex, and no point of a triangle, is farther than 0.5 mm outside of the capsules of its link;
- no capsule distance is larger than the distance of the meshes by more than 1 mm;
- no posture that counts as clear, every distance above the margin, has meshes that touch, checked pairs or not;
- by how much distances are too small: median over pairs and postures at most 12 mm, and of forearm and wrist 3
  while writing at most 3 mm.
"""

import csv
import json
import os
import subprocess
import sys

import coal
import numpy as np

import meshes

OUTSIDE_M = 0.0005
FARTHER_M = 0.001
TYPICAL_M = 0.012
WRITING_M = 0.003

broken = 0


def claim(holds, words):
    global broken
    broken += not holds
    print(f"  {'ok    ' if holds else 'BROKEN'} {words}", flush=True)


def beyond(points, capsule):
    """How far points (... x 3) are outside of a capsule [m]; negative inside."""
    start, along = np.array(capsule["from"]), np.subtract(capsule["to"], capsule["from"])
    share = np.clip((points - start) @ along / max(along @ along, 1e-300), 0, 1)
    return np.linalg.norm(points - start - share[..., None] * along, axis=-1) - capsule["radius"]


def dealt(corners, capsules):
    """Triangles halved until each lies in a capsule, 0.5 mm allowed: per capsule those that it holds, and those that none
    does."""
    shares = [[] for _ in capsules]
    for _ in range(24):
        outside = np.stack([beyond(corners, capsule).max(axis=1) for capsule in capsules])
        for share, own in zip(shares, outside):
            share.append(corners[own <= OUTSIDE_M])
        corners = corners[outside.min(axis=0) > OUTSIDE_M]
        if len(corners) == 0:
            break
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        first = edges.argmax(axis=1)
        turned = corners[np.arange(len(corners))[:, None], (first[:, None] + np.arange(3)) % 3]
        a, b, c = turned.transpose(1, 0, 2)
        corners = np.concatenate([np.stack([a, (a + b) / 2, c], 1), np.stack([(a + b) / 2, b, c], 1)])
    return [np.concatenate(share) for share in shares], corners


def tree(corners):
    """A bounding volume hierarchy of triangles."""
    points, index = np.unique(corners.reshape(-1, 3).round(10), axis=0, return_inverse=True)
    faces = [face for face in index.reshape(-1, 3) if len(set(face.tolist())) == 3]
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points:
        vertices.append(point)
    for a, b, c in faces:
        triangles.append(coal.Triangle(int(a), int(b), int(c)))
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(faces), len(points))
    model.addSubModel(vertices, triangles)
    model.endModel()
    return model


def apart(first, second, frames, links):
    """Distance of two meshes [m], 0 where they touch."""
    places = [coal.Transform3s(frames[link][:3, :3], frames[link][:3, 3]) for link in links]
    return max(coal.distance(first, places[0], second, places[1], coal.DistanceRequest(), coal.DistanceResult()), 0.0)


def daemon(command, arm, poses):
    """The first line, and distances: postures x pairs [m]."""
    lines = "".join(" ".join(repr(float(x)) for x in q) + "\n" for q in poses)
    told = subprocess.run([*command, arm], input=lines, capture_output=True, text=True, check=True).stdout.splitlines()
    return json.loads(told[0]), np.array([[float(x) for x in line.split()] for line in told[1:]])


def written(path, most=400):
    """Joint positions commanded while the law writes, evenly out of all ticks: n x 6 [rad]."""
    with open(path) as file:
        rows = list(csv.DictReader(file))
    return np.array([[float(row[f"q{joint}"]) for joint in range(1, 7)] for row in rows[:: max(1, len(rows) // most)]])


class Meshes:
    def __init__(self, arm, folder, told):
        self.chain = meshes.joints((meshes.ROBOTS / f"{arm}.urdf").read_text())
        corners = meshes.link_meshes(arm, folder)
        self.whole = [tree(link) for link in corners]
        self.pieces = {}
        for link, name in enumerate(meshes.LINKS):
            own = [number for number, capsule in enumerate(told["capsules"]) if capsule["link"] == link]
            capsules = [told["capsules"][number] for number in own]
            points = np.unique(corners[link].reshape(-1, 3), axis=0)
            out = min(np.inf, np.stack([beyond(points, capsule) for capsule in capsules]).min(axis=0).max())
            shares, left = dealt(corners[link], capsules)
            self.pieces.update((number, share) for number, share in zip(own, shares))
            claim(
                out <= OUTSIDE_M and len(left) == 0,
                f"{name}: {len(points)} vertices in {len(own)} capsules, the farthest {max(out, 0) * 1e3:.3f} mm outside; "
                f"every point of {len(corners[link])} triangles is inside",
            )

    def frames(self, q):
        return meshes.forward(self.chain, q)

    def piece(self, number):
        """The triangles that a capsule holds."""
        if not isinstance(self.pieces[number], coal.BVHModelOBBRSS):
            self.pieces[number] = tree(self.pieces[number])
        return self.pieces[number]


def judge(name, arms, told, poses, distances):
    """Claims of one set of postures; the excess per pair of links [m]."""
    pairs, link = told["pairs"], [capsule["link"] for capsule in told["capsules"]]
    between = {}
    for index, (a, b) in enumerate(pairs):
        between.setdefault((link[a], link[b]), []).append(index)
    farthest, touching, clear = -np.inf, [], 0
    excess = {links: [] for links in between}
    for q, row in zip(poses, distances):
        frames = arms.frames(q)
        is_clear = row.min() > told["margin_m"]
        clear += bool(is_clear)
        for first in range(7):
            for second in range(first + 2, 7):
                links = (first, second)
                mine = between.get(links, [])
                if not mine and not is_clear:
                    continue
                mesh = apart(arms.whole[first], arms.whole[second], frames, links)
                if is_clear and mesh <= 0:
                    touching.append(links)
                if not mine:
                    continue
                capsule = row[mine].min()
                # Capsules of links two joints apart that never meet are no pair: then the parts of the meshes that the
                # others hold count.
                if capsule > mesh + FARTHER_M:
                    for index in mine:
                        a, b = pairs[index]
                        parts = apart(arms.piece(a), arms.piece(b), frames, links)
                        farthest = max(farthest, row[index] - parts)
                elif mesh > 0:
                    excess[links].append(mesh - capsule)
                    farthest = max(farthest, capsule - mesh)
    named = lambda links: " and ".join(meshes.LINKS[link] for link in links)
    claim(farthest <= FARTHER_M, f"{name}: {len(poses)} postures, capsules farther apart than meshes by {farthest * 1e3:.2f} mm at most")
    claim(not touching, f"{name}: {clear} postures count as clear, in {len(touching)} of them meshes touch {sorted(set(map(named, touching)))}")
    for links, values in sorted(excess.items()):
        if values:
            print(f"         {named(links)}: too small by {np.median(values) * 1e3:.1f} mm in the median, {max(values) * 1e3:.1f} at most")
    return excess


def main(arm, folder, command, paths):
    dice = np.random.default_rng(44)
    told, _ = daemon(command, arm, [])
    print(f"{arm}: {len(told['capsules'])} capsules, {len(told['pairs'])} pairs of them, margin {told['margin_m'] * 1e3:.0f} mm")
    arms = Meshes(arm, folder, told)
    low, high = np.array(told["limits_rad"]).T
    poses = dice.uniform(low, high, (int(os.environ.get("POSES", "20000")), 6))
    typical = judge("random", arms, told, poses, daemon(command, arm, poses)[1])
    median = np.median(np.concatenate([values for values in typical.values()]))
    claim(median <= TYPICAL_M, f"random: distances are too small by {median * 1e3:.1f} mm in the median over pairs and postures")
    motion = np.concatenate([written(path) for path in paths])
    writing = judge("writing", arms, told, motion, daemon(command, arm, motion)[1])
    median = np.median(np.concatenate([values for values in writing.values()]))
    claim(median <= TYPICAL_M, f"writing: distances are too small by {median * 1e3:.1f} mm in the median over pairs and postures")
    most = max(writing[(3, 6)])
    claim(most <= WRITING_M, f"writing: forearm and wrist_3 too near by {most * 1e3:.1f} mm at most")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3].split(), sys.argv[4:])
    print(f"{sys.argv[1]}: {broken} claims broken")
    sys.exit(min(broken, 99))
