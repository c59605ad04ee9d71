"""The gid of an endpoint in the ROS graph, which each of its messages carries: XXH3 (128 bits) of its token.

As in rmw_zenoh (src/detail/liveliness_utils.cpp, Entity). The hash is that of https://github.com/Cyan4973/xxHash
(doc/xxhash_spec.md), without a seed, for texts of 17 to 1024 bytes: a token is never longer.
"""

from struct import unpack_from

_MASK = (1 << 64) - 1
_P32_1, _P32_2, _P32_3 = 0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D
_P64_1, _P64_2, _P64_3 = 0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9
_P64_4, _P64_5, _MIX = 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5, 0x165667919E3779F9
_SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221"
    "b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb"
    "170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)
_STRIPE = 64  # bytes


def gid_of(token: str) -> bytes:
    """Return the 16 bytes of the endpoint with that token."""
    data = token.encode()
    low, high = _long(data) if len(data) > 240 else _short(data)
    return low.to_bytes(8, "little") + high.to_bytes(8, "little")


def _short(data: bytes) -> tuple[int, int]:
    """Return the hash of 17 to 240 bytes, low half first."""
    size = len(data)
    low, high = size * _P64_1 & _MASK, 0
    if size <= 128:  # pairs of 16 bytes from both ends, the inner ones first
        for at in range(16 * ((size - 1) // 32), -1, -16):
            low, high = _mix(low, high, data, at, size - 16 - at, 2 * at)
    else:
        for at in range(0, 128, 32):
            low, high = _mix(low, high, data, at, at + 16, at)
        low, high = _avalanche(low), _avalanche(high)
        for at in range(128, size - 31, 32):
            low, high = _mix(low, high, data, at, at + 16, at - 125)
        low, high = _mix(low, high, data, size - 16, size - 32, 103)
    whole = low * _P64_1 + high * _P64_4 + size * _P64_2
    return _avalanche(low + high & _MASK), -_avalanche(whole & _MASK) & _MASK


def _long(data: bytes) -> tuple[int, int]:
    """Return the hash of 241 to 1024 bytes, low half first."""
    sums = [_P32_3, _P64_1, _P64_2, _P64_3, _P64_4, _P32_2, _P64_5, _P32_1]
    for stripe in range((len(data) - 1) // _STRIPE):
        _add(sums, data, _STRIPE * stripe, 8 * stripe)
    _add(sums, data, len(data) - _STRIPE, 121)
    return _merge(sums, 11, len(data) * _P64_1 & _MASK), _merge(sums, 117, ~(len(data) * _P64_2) & _MASK)


def _mix(low: int, high: int, data: bytes, first: int, second: int, at: int) -> tuple[int, int]:
    """Add two pieces of 16 bytes to both halves, with the secret at `at`."""
    a, b = unpack_from("<2Q", data, first)
    c, d = unpack_from("<2Q", data, second)
    s, t, u, v = unpack_from("<4Q", _SECRET, at)
    low, high = low + _fold(a ^ s, b ^ t), high + _fold(c ^ u, d ^ v)
    return (low & _MASK) ^ (c + d & _MASK), (high & _MASK) ^ (a + b & _MASK)


def _add(sums: list[int], data: bytes, start: int, at: int) -> None:
    """Add a stripe to the sums, with the secret at `at`."""
    pairs = zip(unpack_from("<8Q", data, start), unpack_from("<8Q", _SECRET, at), strict=True)
    for lane, (value, secret) in enumerate(pairs):
        key = value ^ secret
        sums[lane ^ 1] = sums[lane ^ 1] + value & _MASK
        sums[lane] = sums[lane] + (key & 0xFFFFFFFF) * (key >> 32) & _MASK


def _merge(sums: list[int], at: int, start: int) -> int:
    secret = unpack_from("<8Q", _SECRET, at)
    folded = [_fold(sums[lane] ^ secret[lane], sums[lane + 1] ^ secret[lane + 1]) for lane in range(0, 8, 2)]
    return _avalanche(start + sum(folded) & _MASK)


def _fold(a: int, b: int) -> int:
    product = a * b
    return product & _MASK ^ product >> 64


def _avalanche(value: int) -> int:
    value = (value ^ value >> 37) * _MIX & _MASK
    return value ^ value >> 32
