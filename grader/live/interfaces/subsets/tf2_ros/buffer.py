"""Transforms over time between the frames of a tree."""

import bisect
import math
import threading
import time as clock

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time

#: Frames on the way to the root at most: more is a circle.
_MOST_FRAMES = 1000
_CACHE_NS = 10_000_000_000
_LOOK_S = 0.02
#: Largest difference of a quaternion's squared length from 1, as in tf2's BufferCore.
_UNIT_WITHIN = 0.01
_AT_ONCE = Duration()


class TransformException(Exception):
    """A transform is not known."""


class LookupException(TransformException):
    """A frame is not known."""


class ConnectivityException(TransformException):
    """Two frames are in no common tree."""


class ExtrapolationException(TransformException):
    """The requested time is outside the known transforms."""


class InvalidArgumentException(TransformException):
    """An argument is no frame, or no transform."""


class TimeoutException(TransformException):
    """The transform was not known within the timeout."""


def lacking(name):
    """Return the error for a name of the real package that is missing here."""
    module = f"tf2_ros.{name}"
    return ModuleNotFoundError(f"No module named '{module}'", name=module)


def _ns(stamp):
    return (
        stamp.nanoseconds
        if hasattr(stamp, "nanoseconds")
        else stamp.sec * 1_000_000_000 + stamp.nanosec
    )


def _product(a, b):
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _turned(rotation, vector):
    x, y, z, w = rotation
    return _product(_product(rotation, (*vector, 0.0)), (-x, -y, -z, w))[:3]


def _composed(first, second):
    """Return the transform that does the second, and then the first: each a translation and a unit quaternion."""
    moved = _turned(first[1], second[0])
    return tuple(a + b for a, b in zip(first[0], moved, strict=True)), _product(first[1], second[1])


def _inverse(transform):
    (x, y, z, w) = transform[1]
    back = (-x, -y, -z, w)
    return tuple(-part for part in _turned(back, transform[0])), back


def _between(first, second, share):
    """Interpolate: translations on a line, rotations on the shorter arc."""
    translation = tuple(a + (b - a) * share for a, b in zip(first[0], second[0], strict=True))
    a, b = first[1], second[1]
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    if cosine < 0:
        b, cosine = tuple(-part for part in b), -cosine
    angle = math.acos(min(1.0, cosine))
    if angle < 1e-6:
        return translation, b
    weights = (
        math.sin((1 - share) * angle) / math.sin(angle),
        math.sin(share * angle) / math.sin(angle),
    )
    return translation, tuple(weights[0] * p + weights[1] * q for p, q in zip(a, b, strict=True))


class _Frame:
    """Where a frame is in its parent, over time; a static one has one transform for all times."""

    def __init__(self, is_static):
        self.is_static = is_static
        self.times, self.samples = (
            [],
            [],
        )  # in ns, in order; and at each of them (parent, transform)

    def add(self, time_ns, sample, cache_ns):
        if self.is_static:
            self.times, self.samples = [time_ns], [sample]
            return
        if self.times and time_ns < self.times[-1] - cache_ns:
            return
        place = bisect.bisect_left(self.times, time_ns)
        end = place + (self.times[place : place + 1] == [time_ns])
        self.times[place:end], self.samples[place:end] = [time_ns], [sample]
        old = bisect.bisect_left(self.times, self.times[-1] - cache_ns)
        del self.times[:old], self.samples[:old]

    def at(self, time_ns, name):
        """Return the parent and the transform at a time, 0 for the latest."""
        times = self.times
        if self.is_static or time_ns == 0 or time_ns == times[-1]:
            return self.samples[-1]
        if not times[0] <= time_ns <= times[-1]:
            way = "past" if time_ns < times[0] else "future"
            raise ExtrapolationException(
                f"Lookup would require extrapolation into the {way}.  Requested time {time_ns / 1e9:.6f} but the "
                f"{'earliest' if way == 'past' else 'latest'} data is at time "
                f"{times[0 if way == 'past' else -1] / 1e9:.6f}, when looking up transform of frame [{name}]"
            )
        place = bisect.bisect_right(times, time_ns)
        (before_ns, after_ns) = times[place - 1 : place + 1]
        (parent, before), (later_parent, after) = self.samples[place - 1 : place + 1]
        if parent != later_parent:
            return parent, before
        return parent, _between(before, after, (time_ns - before_ns) / (after_ns - before_ns))


class Buffer:
    """Keeps the transforms of the last ten seconds, and of static ones the last."""

    def __init__(self, cache_time=None, node=None):
        # The real one offers a service on the node, which tools ask for a picture of the tree.
        self._cache_ns = _CACHE_NS if cache_time is None else cache_time.nanoseconds
        self._frames, self._known = {}, set()  # those with a parent, and these with their parents
        self._lock = threading.RLock()

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        raise lacking(f"Buffer.{name}")

    # -- filling ------------------------------------------------------------------------------

    def set_transform(self, transform, authority):
        """Take note of a transform at its time."""
        self._set(transform, False)

    def set_transform_static(self, transform, authority):
        """Take note of a transform for all times."""
        self._set(transform, True)

    def clear(self):
        """Forget all transforms."""
        with self._lock:
            self._frames.clear()
            self._known.clear()

    def _set(self, stamped, is_static):
        child, parent = stamped.child_frame_id.lstrip("/"), stamped.header.frame_id.lstrip("/")
        t, r = stamped.transform.translation, stamped.transform.rotation
        rotation = (r.x, r.y, r.z, r.w)
        length = math.sqrt(sum(part * part for part in rotation))
        numbers = (t.x, t.y, t.z, *rotation)
        # The real buffer takes note of none of these, and says so in its log.
        if not child or not parent or child == parent or not all(map(math.isfinite, numbers)):
            return
        if abs(length * length - 1.0) >= _UNIT_WITHIN:
            return
        value = (t.x, t.y, t.z), tuple(part / length for part in rotation)
        with self._lock:
            frame = self._frames.get(child)
            if frame is None or frame.is_static != is_static:
                frame = self._frames[child] = _Frame(is_static)
            frame.add(_ns(stamped.header.stamp), (parent, value), self._cache_ns)
            self._known |= {child, parent}

    # -- asking -------------------------------------------------------------------------------

    def lookup_transform(self, target_frame, source_frame, time, timeout=_AT_ONCE):
        """Return the transform from the source frame into the target frame."""
        self.can_transform(target_frame, source_frame, time, timeout)
        return self.lookup_transform_core(target_frame, source_frame, time)

    def can_transform(
        self, target_frame, source_frame, time, timeout=_AT_ONCE, return_debug_tuple=False
    ):
        """Return whether the transform is known, or becomes known within the timeout."""
        end_s = clock.monotonic() + timeout.nanoseconds / 1e9
        while not (found := self.can_transform_core(target_frame, source_frame, time))[0]:
            if clock.monotonic() >= end_s:
                break
            clock.sleep(_LOOK_S)
        return found if return_debug_tuple else found[0]

    def can_transform_core(self, target_frame, source_frame, time):
        """Return whether the transform is known, and if not, why."""
        try:
            self.lookup_transform_core(target_frame, source_frame, time)
        except TransformException as problem:
            return False, str(problem)
        return True, ""

    def lookup_transform_core(self, target_frame, source_frame, time):
        """Return the transform that is known now."""
        for frame in (target_frame, source_frame):
            if not isinstance(frame, str) or not frame or frame.startswith("/"):
                raise InvalidArgumentException(
                    f"Invalid frame ID \"{frame}\": it cannot be empty or begin with a '/'"
                )
        with self._lock:
            time_ns = _ns(time) or self._latest_common_ns(target_frame, source_frame)
            (_, translation, rotation) = self._found(target_frame, source_frame, time_ns)
        answer = TransformStamped()
        answer.header.frame_id, answer.child_frame_id = target_frame, source_frame
        answer.header.stamp = Time(nanoseconds=time_ns).to_msg()
        t, r = answer.transform.translation, answer.transform.rotation
        t.x, t.y, t.z = translation
        r.x, r.y, r.z, r.w = rotation
        return answer

    def _found(self, target, source, time_ns):
        for name in (target, source):
            if name not in self._known:
                raise LookupException(
                    f'"{name}" passed to lookupTransform argument does not exist. '
                )
        of_target, of_source = self._way_up(target), self._way_up(source)
        common = next((name for name in of_source if name in of_target), None)
        if common is None:
            raise ConnectivityException(
                f"Could not find a connection between '{target}' and '{source}' because they are not part of the same "
                "tree.Tf has two or more unconnected trees."
            )
        down, up = (self._to(common, name, time_ns) for name in (target, source))
        return common, *_composed(_inverse(down), up)

    def _way_up(self, name):
        """Return a frame and those above it, by the latest parents."""
        way = [name]
        while name in self._frames and len(way) < _MOST_FRAMES:
            name = self._frames[name].samples[-1][0]
            way.append(name)
        return way

    def _to(self, above, name, time_ns):
        """Return the transform from a frame to one above it."""
        whole, at = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), name
        for _ in range(_MOST_FRAMES):
            if at == above:
                return whole
            if at not in self._frames:
                break
            parent, transform = self._frames[at].at(time_ns, at)
            whole, at = _composed(transform, whole), parent
        # Its parents were others at that time.
        raise ConnectivityException(
            f"Could not find a connection between '{above}' and '{name}' at that time."
        )

    def _latest_common_ns(self, target, source):
        """Return the latest time with all transforms between two frames known; 0 if all are static."""
        of_target, of_source = self._way_up(target), self._way_up(source)
        ways = {*of_target} ^ {*of_source}
        moving = [
            self._frames[name]
            for name in ways
            if name in self._frames and not self._frames[name].is_static
        ]
        return min((frame.times[-1] for frame in moving), default=0)
