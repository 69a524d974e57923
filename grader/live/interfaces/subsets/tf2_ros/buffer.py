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
#: Translation and rotation that change nothing.
_IDENTITY = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


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
    if hasattr(stamp, "nanoseconds"):
        return stamp.nanoseconds
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def _product(a, b):
    """Return the Hamilton product of two quaternions."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    return x, y, z, w


def _turned(rotation, vector):
    half_turned = _product(rotation, (*vector, 0.0))
    turned = _product(half_turned, _conjugate(rotation))
    return turned[:3]


def _conjugate(rotation):
    x, y, z, w = rotation
    return -x, -y, -z, w


def _composed(first, second):
    """Return the transform that does the second, and then the first: each a translation and a unit quaternion."""
    first_translation, first_rotation = first
    second_translation, second_rotation = second
    moved = _turned(first_rotation, second_translation)
    translation = tuple(a + b for a, b in zip(first_translation, moved, strict=True))
    return translation, _product(first_rotation, second_rotation)


def _inverse(transform):
    translation, rotation = transform
    back = _conjugate(rotation)
    moved = _turned(back, translation)
    return _negated(moved), back


def _negated(parts):
    return tuple(-part for part in parts)


def _between(first, second, share):
    """Interpolate: translations on a line, rotations on the shorter arc."""
    first_translation, first_rotation = first
    second_translation, second_rotation = second
    translations = zip(first_translation, second_translation, strict=True)
    translation = tuple(a + (b - a) * share for a, b in translations)
    return translation, _rotation_between(first_rotation, second_rotation, share)


def _rotation_between(first, second, share):
    cosine = sum(p * q for p, q in zip(first, second, strict=True))
    if cosine < 0:
        second = _negated(second)
        cosine = -cosine
    angle = math.acos(min(1.0, cosine))
    if angle < 1e-6:
        return second
    sine = math.sin(angle)
    of_first = math.sin((1 - share) * angle) / sine
    of_second = math.sin(share * angle) / sine
    return tuple(of_first * p + of_second * q for p, q in zip(first, second, strict=True))


class _Frame:
    """Where a frame is in its parent, over time; a static one has one transform for all times."""

    def __init__(self, is_static):
        self.is_static = is_static
        #: Times in ns, in order.
        self.times = []
        #: Parent and transform at each of the times.
        self.samples = []

    def add(self, time_ns, sample, cache_ns):
        if self.is_static:
            self.times = [time_ns]
            self.samples = [sample]
            return
        if self.times and time_ns < self.times[-1] - cache_ns:
            return
        place = bisect.bisect_left(self.times, time_ns)
        is_known = self.times[place : place + 1] == [time_ns]
        end = place + is_known
        self.times[place:end] = [time_ns]
        self.samples[place:end] = [sample]
        oldest_ns = self.times[-1] - cache_ns
        old = bisect.bisect_left(self.times, oldest_ns)
        del self.times[:old]
        del self.samples[:old]

    def at(self, time_ns, name):
        """Return the parent and the transform at a time, 0 for the latest."""
        times = self.times
        if self.is_static or time_ns == 0 or time_ns == times[-1]:
            return self.samples[-1]
        if time_ns < times[0]:
            raise _outside("past", "earliest", time_ns, times[0], name)
        if time_ns > times[-1]:
            raise _outside("future", "latest", time_ns, times[-1], name)
        place = bisect.bisect_right(times, time_ns)
        before_ns = times[place - 1]
        after_ns = times[place]
        parent, before = self.samples[place - 1]
        later_parent, after = self.samples[place]
        if parent != later_parent:
            return parent, before
        share = (time_ns - before_ns) / (after_ns - before_ns)
        return parent, _between(before, after, share)


def _outside(way, extreme, requested_ns, known_ns, name):
    """Return the error for a time before or after all samples of a frame."""
    return ExtrapolationException(
        f"Lookup would require extrapolation into the {way}.  Requested time {requested_ns / 1e9:.6f} but the "
        f"{extreme} data is at time {known_ns / 1e9:.6f}, when looking up transform of frame [{name}]"
    )


def _valid(transform):
    """Return translation and unit rotation of a message; None for numbers that are no transform."""
    t = transform.translation
    r = transform.rotation
    translation = (t.x, t.y, t.z)
    rotation = (r.x, r.y, r.z, r.w)
    length = math.sqrt(sum(part * part for part in rotation))
    if not all(map(math.isfinite, (*translation, *rotation))):
        return None
    if abs(length * length - 1.0) >= _UNIT_WITHIN:
        return None
    return translation, tuple(part / length for part in rotation)


class Buffer:
    """Keeps the transforms of the last ten seconds, and of static ones the last."""

    def __init__(self, cache_time=None, node=None):
        # The real one offers a service on the node, which tools ask for a picture of the tree.
        self._cache_ns = _CACHE_NS if cache_time is None else cache_time.nanoseconds
        #: Frames with a parent, by name.
        self._frames = {}
        #: Names of these frames and of their parents.
        self._known = set()
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
        child = stamped.child_frame_id.lstrip("/")
        parent = stamped.header.frame_id.lstrip("/")
        # The real buffer also ignores invalid frames and values, and logs them.
        if not child or not parent or child == parent:
            return
        value = _valid(stamped.transform)
        if value is None:
            return
        time_ns = _ns(stamped.header.stamp)
        with self._lock:
            frame = self._frames.get(child)
            if frame is None or frame.is_static != is_static:
                frame = _Frame(is_static)
                self._frames[child] = frame
            frame.add(time_ns, (parent, value), self._cache_ns)
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
        is_known, reason = self.can_transform_core(target_frame, source_frame, time)
        while not is_known and clock.monotonic() < end_s:
            clock.sleep(_LOOK_S)
            is_known, reason = self.can_transform_core(target_frame, source_frame, time)
        if return_debug_tuple:
            return is_known, reason
        return is_known

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
        answer.header.frame_id = target_frame
        answer.child_frame_id = source_frame
        answer.header.stamp = Time(nanoseconds=time_ns).to_msg()
        t = answer.transform.translation
        r = answer.transform.rotation
        t.x, t.y, t.z = translation
        r.x, r.y, r.z, r.w = rotation
        return answer

    def _found(self, target, source, time_ns):
        for name in (target, source):
            if name not in self._known:
                raise LookupException(
                    f'"{name}" passed to lookupTransform argument does not exist. '
                )
        of_target = self._way_up(target)
        of_source = self._way_up(source)
        common = next((name for name in of_source if name in of_target), None)
        if common is None:
            raise ConnectivityException(
                f"Could not find a connection between '{target}' and '{source}' because they are not part of the same "
                "tree.Tf has two or more unconnected trees."
            )
        down = self._to(common, target, time_ns)
        up = self._to(common, source, time_ns)
        translation, rotation = _composed(_inverse(down), up)
        return common, translation, rotation

    def _way_up(self, name):
        """Return a frame and those above it, by the latest parents."""
        way = [name]
        while name in self._frames and len(way) < _MOST_FRAMES:
            name = self._frames[name].samples[-1][0]
            way.append(name)
        return way

    def _to(self, above, name, time_ns):
        """Return the transform from a frame to one above it."""
        whole = _IDENTITY
        at = name
        for _ in range(_MOST_FRAMES):
            if at == above:
                return whole
            if at not in self._frames:
                break
            parent, transform = self._frames[at].at(time_ns, at)
            whole = _composed(transform, whole)
            at = parent
        # Its parents were others at that time.
        raise ConnectivityException(
            f"Could not find a connection between '{above}' and '{name}' at that time."
        )

    def _latest_common_ns(self, target, source):
        """Return the latest time with all transforms between two frames known; 0 if all are static."""
        way = set(self._way_up(target)) ^ set(self._way_up(source))
        frames = [self._frames[name] for name in way if name in self._frames]
        return min((frame.times[-1] for frame in frames if not frame.is_static), default=0)
