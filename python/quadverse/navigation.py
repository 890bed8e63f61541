"""What a robot needs beside ``policy.onnx`` of ``qv navigate train``: its memory of where it looked, and the last word on a command.

The same as ``recall.rs`` and ``reflex.rs`` of the crate qv-nav, which explain it; a test compares both. Needs numpy, and onnxruntime for
:class:`Navigator`. Lengths are metres, angles radians, positive to the left.
"""

import math

import numpy as np

CELL, CELLS, SECTORS, RAYS = 0.1, 160, 24, 12
RINGS = np.array([0.25, 0.4, 0.55, 0.75, 1.0, 1.5, 2.2, 3.3, 5.0])
RAY_STEP, FARTHEST, NEAREST, CAMERA, AGE, KEPT = 0.08, 6.0, 0.05, 0.30, 0.4, 0.96
HEAD, TAIL = 0.33, 0.30
COLOURS = ("red", "blue", "yellow")
#: Colours with names of a policy that takes any colour, red, green, blue as shown.
NAMED = {
    "red": (0.86, 0.23, 0.20),
    "orange": (0.95, 0.50, 0.10),
    "yellow": (0.91, 0.77, 0.17),
    "green": (0.15, 0.65, 0.25),
    "cyan": (0.10, 0.75, 0.80),
    "blue": (0.20, 0.36, 0.80),
    "purple": (0.55, 0.20, 0.75),
    "pink": (0.95, 0.35, 0.65),
}


#: The hue that a policy looks for that takes any colour [degrees].
SOUGHT = 2.0


def goal_turn(colour):
    """How far hues are turned for a goal [degrees]: a name of :data:`NAMED`, ``#rrggbb``, or three numbers 0 to 1."""
    if isinstance(colour, str):
        digits = colour[1:] if colour.startswith("#") and len(colour) == 7 else None
        if colour not in NAMED and digits is None:
            raise ValueError(f"colour: expected {', '.join(NAMED)} or #rrggbb, found {colour}")
        colour = NAMED[colour] if colour in NAMED else [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    r, g, b = (float(c) for c in colour)
    most, least = max(r, g, b), min(r, g, b)
    if most <= 0.0 or (most - least) / most < 0.35:
        raise ValueError(f"colour: expected one with a hue, found {[r, g, b]}")
    sector = (g - b if most == r else b - r if most == g else r - g) / (most - least)
    return SOUGHT - (60.0 * (sector + (0.0 if most == r else 2.0 if most == g else 4.0))) % 360.0


def turn_hues(frame, degrees):
    """A picture, uint8 [..., 3], with its hues turned by an angle [degrees]; saturation and value stay."""
    turn = np.float32(degrees / 60.0 % 6.0)
    if turn == 0.0:
        return frame
    rgb = frame.astype(np.float32)
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    most, least = rgb.max(-1), rgb.min(-1)
    spread = most - least
    safe = np.where(spread > 0.0, spread, np.float32(1.0))
    green = np.where(most == g, (b - r) / safe + np.float32(2.0), (r - g) / safe + np.float32(4.0))
    sector = (np.where(most == r, (g - b) / safe, green) + turn) % np.float32(6.0)
    offsets = np.array([0.0, 4.0, 2.0], np.float32)
    off = np.clip(np.abs((sector[..., None] + offsets) % np.float32(6.0) - np.float32(3.0)) - np.float32(1.0), 0.0, 1.0)
    turned = (least[..., None] + spread[..., None] * off + np.float32(0.5)).astype(np.uint8)
    return np.where(spread[..., None] > 0.0, turned, frame)



def _turn(angle, points):
    c, s = math.cos(angle), math.sin(angle)
    points = np.asarray(points, float)
    return np.stack([c * points[..., 0] - s * points[..., 1], s * points[..., 0] + c * points[..., 1]], -1)


def _unit(v, otherwise):
    length = np.hypot(*v)
    return v / length if np.isfinite(length) and length > 1e-12 else np.array(otherwise, float)


class Recall:
    """Memory of one episode; ``half`` are the half sides of the place's map, which the file of the policy tells."""

    def __init__(self, half):
        self.half = np.array(half, float)
        self.odds = np.zeros((CELLS, CELLS), np.float32)  # rows along y
        self.looked = np.zeros((CELLS, CELLS), bool)
        self.before = self.now = (np.zeros(2), 0.0)
        self.spotted, self.age = None, 0.0
        self.weight, self.said, self.at, self.way = 0.0, np.zeros(2), np.zeros(2), np.zeros(2)
        axis = (np.arange(CELLS) + 0.5 - 0.5 * CELLS) * CELL
        self.centres = np.stack(np.meshgrid(axis, axis), -1)
        share = (np.arange(SECTORS)[:, None] + (np.arange(3) + 0.5) / 3 - 0.5) * (2 * math.pi / SECTORS)
        distance = RINGS[:-1, None] + np.diff(RINGS)[:, None] * ((np.arange(4) + 0.5) / 4)
        axes = np.stack([np.cos(share), np.sin(share)], -1)
        # [sector, ring, along, across, 2]
        self.points = distance[None, :, :, None, None] * axes[:, None, None, :, :]

    def _cells(self, points):
        at = np.floor(np.asarray(points) / CELL + 0.5 * CELLS)
        inside = np.all((at >= 0) & (at < CELLS), -1)
        at = np.where(inside[..., None], at, 0).astype(int)
        return at[..., 1], at[..., 0], inside

    def _odds(self, points):
        j, i, inside = self._cells(points)
        return np.where(inside, self.odds[j, i], 0.0)

    def go(self, x, y, yaw):
        """Goes to where odometry says, from the start on; once for each decision, before :meth:`features`."""
        self.before, self.now = self.now, (np.array([x, y], float), float(yaw))
        self.age += 1.0
        body = np.stack([-0.25 + 0.5 * np.arange(9) / 8, np.zeros(9)], -1)
        j, i, inside = self._cells(self.now[0] + _turn(yaw, body))
        self.odds[j[inside], i[inside]] = -2.0

    def see(self, sight):
        """Takes in the output ``sight`` of the network."""
        sight = np.asarray(sight, float)
        place = self.now[0] + AGE * (self.before[0] - self.now[0])
        yaw = self.now[1] + AGE * (self.before[1] - self.now[1])
        if sight[3] > 0.5:
            cone = place + _turn(yaw, math.exp(min(max(sight[2], -3.0), 2.5)) * _unit(sight[[1, 0]], (1, 0)))
            near = self.spotted is not None and np.hypot(*(self.spotted - cone)) < 1.0
            self.spotted, self.age = (0.5 * self.spotted + 0.5 * cone if near else cone), 0.0
        heading = sight[[7, 6]]
        weight = min(heading @ heading, 1.0) ** 2
        self.weight = KEPT * self.weight + weight
        self.said = KEPT * self.said + weight * sight[4:6] * self.half
        self.at = KEPT * self.at + weight * place
        self.way = KEPT * self.way + weight * _turn(-yaw, _unit(heading, (0, 0)))
        walk, view = np.clip(np.exp(sight[8:].reshape(2, RAYS)), NEAREST, FARTHEST)
        p = _turn(-yaw, self.centres - (place + _turn(yaw, (CAMERA, 0.0))))
        distance = np.hypot(p[..., 0], p[..., 1])
        at = np.arctan2(p[..., 1], p[..., 0]) / RAY_STEP + 0.5 * (RAYS - 1)
        shown = (p[..., 0] > 0.85 * distance) & (distance <= 5.0) & (at >= -0.5) & (at <= RAYS - 0.5)
        ray = np.clip(np.floor(np.maximum(at, 0.0) + 0.5), 0, RAYS - 1).astype(int)
        walk, view = walk[ray], view[ray]
        self.looked |= shown & (distance < view - 0.1)
        off = 0.05 + 0.07 * walk
        free = shown & (distance < walk - off)
        hit = shown & ~free & (distance < walk + off) & (walk < 3.0)
        self.odds = np.where(free, np.maximum(self.odds - np.float32(0.6), -2.0), self.odds)
        more = (1.2 / (1.0 + walk)).astype(np.float32)
        self.odds = np.where(hit, np.minimum(self.odds + more, 2.0), self.odds).astype(np.float32)

    def features(self):
        """The input ``recall`` of the network."""
        (place, yaw), rest = self.now, np.zeros(14)
        j, i, inside = self._cells(place + _turn(yaw, self.points))
        blocked = 0.5 * np.where(inside, self.odds[j, i], 0.0).max((2, 3))
        looked = (self.looked[j, i] & inside).mean((2, 3))
        if self.spotted is not None:
            to = _turn(-yaw, self.spotted - place)
            distance = max(np.hypot(*to), 0.05)
            rest[:5] = 1.0, to[1] / distance, to[0] / distance, math.log(distance), min(0.04 * self.age, 3.0)
        if self.weight > 1e-3:
            way = _unit(self.way, (1, 0))
            angle = math.atan2(way[1], way[0])
            share = (self.said / self.weight + _turn(angle, place - self.at / self.weight)) / self.half
            sure = np.hypot(*self.way) / self.weight * (self.weight / (1.0 + self.weight))
            rest[5:7] = np.clip(share, -2.0, 2.0)
            rest[7:10] = math.sin(angle + yaw), math.cos(angle + yaw), sure
        rest[10:] = math.sin(yaw), math.cos(yaw), place[0] / 3.0, place[1] / 3.0
        return np.concatenate([blocked.ravel(), looked.ravel(), rest]).astype(np.float32)


def reflex(recall, command, odds=1.1, margin=0.16, push=0.5, stand_off=0.25, approach=1.0, creep=0.06):
    """The command (forwards, to the left, turning) that is followed instead: away from what blocks, slow before the cone."""
    ahead, aside, turning = (float(x) for x in command)
    place, yaw = recall.now
    if recall.spotted is not None and recall.age < 15.0:
        x, y = _turn(-yaw, recall.spotted - place)
        if x > 0.0 and abs(y) < 0.25 + 0.3 * x:
            ahead = min(ahead, max(approach * (math.hypot(x - HEAD, y) - stand_off), creep))
    reach = math.ceil((margin + 0.5 * CELL) / CELL)
    steps = CELL * np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), -1).reshape(-1, 2)
    for along in (HEAD, 0.5 * HEAD, 0.0, -TAIL):
        blocks = steps[recall._odds(place + _turn(yaw, np.array([along, 0.0]) + steps)) > odds]
        if not len(blocks):
            continue
        nearest = blocks[np.argmin(np.hypot(blocks[:, 0], blocks[:, 1]))]
        room = max(np.hypot(*nearest) - 0.5 * CELL, 0.0)
        if room >= margin:
            continue
        out = _unit(-nearest, (-1, 0))
        lack = (margin - room) / margin * push - (ahead * out[0] + (aside + turning * along) * out[1])
        if lack > 0.0:
            ahead += lack * out[0]
            aside += lack * out[1] * (1.0 if along == 0.0 else 0.5)
            turning += 0.0 if along == 0.0 else 0.5 * lack * out[1] / along
    return [min(max(ahead, -0.2), 0.6), min(max(aside, -0.3), 0.3), min(max(turning, -1.0), 1.0)]


class Navigator:
    """A policy that decides five times a second; a new one for each cone that is to be found."""

    def __init__(self, policy, colour):
        import onnxruntime

        self.session = onnxruntime.InferenceSession(str(policy), providers=["CPUExecutionProvider"])
        metadata = self.session.get_modelmeta().custom_metadata_map
        self.recall = Recall([float(x) for x in metadata["half_sides"].split()])
        takes_any = metadata.get("goal") == "colour"
        self.turn = goal_turn(colour) if takes_any else 0.0
        self.colour = np.eye(3, dtype=np.float32)[0 if takes_any else COLOURS.index(colour)]
        self.memory = np.zeros((1, 192), np.float32)
        self.last = np.zeros(3)

    def decide(self, frame, gravity, odometry):
        """``frame`` is uint8 [480, 640, 3]; ``gravity`` a unit vector in the base; ``odometry`` x, y, yaw since the start. Gives
        forwards, to the left [m/s], turning [rad/s]."""
        frame = np.ascontiguousarray(frame, np.uint8)
        if frame.shape != (480, 640, 3):
            raise ValueError(f"frame: expected the shape (480, 640, 3), found {frame.shape}")
        self.recall.go(*odometry)
        frame = turn_hues(frame, self.turn)
        state = np.concatenate([self.colour, np.asarray(gravity, np.float32)])[None]
        inputs = dict(frame=frame[None], state=state, recall=self.recall.features()[None], memory=self.memory)
        command, sight, self.memory = self.session.run(["command", "sight", "next_memory"], inputs)
        wanted = np.array(reflex(self.recall, command[0]))
        self.recall.see(sight[0])
        change = np.array([0.3, 0.3, 1.0])
        self.last = np.clip(wanted, self.last - change, self.last + change)
        return self.last
