"""GLSL shaders of the OpenGL ray engine: each program draws one kind of solid.

All positions are in m from the camera along the world's axes. Triangles only select the pixels that an object may
cover; the hit of the pixel's ray is then computed as in sim/rays/single.py and sim/rays/seabed.py, in 32-bit floats.
"""

from typing import NamedTuple

from sim.rays.solids import BOX, SPHERE


class Program(NamedTuple):
    """The two shaders of a program."""

    vertex: str
    fragment: str


_CAMERA = """
#version 330
uniform mat3 rotation;  // from the camera's axes (ahead, right, down) into the world's
uniform vec2 size;      // pixels
uniform float focal;    // pixels
uniform float reach;    // m
"""

_PROJECTION = f"""{_CAMERA}
vec4 projected(vec3 place) {{
    vec3 own = place * rotation;
    return vec4(2.0 * focal / size * own.yz, 0.0, own.x);
}}
"""

_RAY = f"""{_CAMERA}
const float INF = uintBitsToFloat(0x7f800000u), NAN = uintBitsToFloat(0x7fc00000u), TINY = 1e-12;
layout(location = 0) out vec4 found;  // the normal and how far, m
layout(location = 1) out int thing;

vec3 ray() {{
    return rotation * normalize(vec3(1.0, (gl_FragCoord.xy - 0.5 * size) / focal));
}}

void meet(float way, vec3 normal, int what) {{
    if (!(way >= 0.0 && way <= reach))
        discard;
    found = vec4(normal, way);
    thing = what;
    gl_FragDepth = 0.5 * way / reach;
}}
"""

# All half spaces at once, over the whole picture. Pixels without a hit get NOTHING, so no texture has to be cleared.
PLANES = Program(
    """
#version 330
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }
""",
    f"""{_RAY}
uniform sampler2D planes;  // one a column: its normal and how far the camera is from it; below, what it is
void main() {{
    vec3 along = ray();
    found = vec4(NAN, NAN, NAN, INF);
    thing = -1;
    for (int i = 0; i < textureSize(planes, 0).x; i++) {{
        vec4 plane = texelFetch(planes, ivec2(i, 0), 0);
        float rate = dot(plane.xyz, along), way = plane.w <= 0.0 ? 0.0 : rate < 0.0 ? -plane.w / rate : INF;
        if (way < found.w && way <= reach) {{
            found = vec4(plane.xyz, way);
            thing = int(texelFetch(planes, ivec2(i, 1), 0).x);
        }}
    }}
    gl_FragDepth = thing < 0 ? 1.0 : 0.5 * found.w / reach + 1e-6;  // a hair behind the seabed that ends in a wall
}}
""",
)

# An instance is a strip of cells with two triangles each, divided by the higher diagonal. So the triangles are above
# the bilinear surface and meet it at the cell's edges: each ray that hits the surface passes them in the same cell.
SEABED = Program(
    f"""{_PROJECTION}
uniform sampler2D depths;  // m below the camera, a row a row of nodes
in vec2 north, east;       // from where to where the strip reaches, and the cell
flat out vec4 cell, corners;
out vec3 place;
float depth(int row, int column) {{ return texelFetch(depths, ivec2(column, row), 0).x; }}
void main() {{
    int column = gl_VertexID / 6, row = gl_InstanceID, vertex = gl_VertexID % 6;
    cell = vec4(north, east);
    corners = vec4(depth(row, column), depth(row, column + 1), depth(row + 1, column), depth(row + 1, column + 1));
    int cut = corners.x + corners.w < corners.y + corners.z ? 2 : 3;
    int up = int(vertex == 2 || vertex > 3), right = int(vertex == 1 || vertex == 4 || vertex == cut);
    place = vec3(north[up], east[right], corners[2 * up + right]);
    gl_Position = projected(place);
}}
""",
    f"""{_RAY}
flat in vec4 cell, corners;
in vec3 place;
const float UNKNOWN = -9e5, PIXEL = 0.01;  // in pixels, how exactly triangles are drawn
void step(vec3 spot, vec3 normal, float one, float other) {{  // at the edge of the grid, from one depth to the other
    if (abs(2.0 * spot.z - one - other) > abs(one - other) + 1e-4)
        discard;
    meet(length(spot), normal, 0);
}}
void main() {{
    vec3 along = ray();
    vec2 extent = cell.yw - cell.xz;
    if (extent.x == 0.0) {{
        vec3 spot = along * (cell.x / along.x);
        vec2 ends = mix(corners.xz, corners.yw, (spot.y - cell.z) / extent.y);
        step(spot, vec3(-sign(along.x), 0.0, 0.0), ends.x, ends.y);
    }} else if (extent.y == 0.0) {{
        vec3 spot = along * (cell.z / along.y);
        vec2 ends = mix(corners.xy, corners.zw, (spot.x - cell.x) / extent.x);
        step(spot, vec3(0.0, -sign(along.y), 0.0), ends.x, ends.y);
    }} else {{
        if (min(min(corners.x, corners.y), min(corners.z, corners.w)) < UNKNOWN)
            discard;  // a column of its own stands there
        vec2 level = mix(along.xy, vec2(TINY), lessThan(abs(along.xy), vec2(TINY)));
        vec2 one = cell.xz / level, other = cell.yw / level;
        vec2 into = min(one, other), out_of = max(one, other);
        float near = max(max(into.x, into.y), 0.0), passed = min(out_of.x, out_of.y) - near;
        float north = corners.z - corners.x, east = corners.y - corners.x;
        float twist = corners.x - corners.y - corners.z + corners.w;
        vec2 at = clamp((along.xy * near - cell.xz) / extent, 0.0, 1.0), rate = along.xy / extent;
        float p = along.z * near - (corners.x + north * at.x + east * at.y + twist * at.x * at.y);
        float q = along.z - (north * rate.x + east * rate.y + twist * (at.x * rate.y + at.y * rate.x));
        float r = -twist * rate.x * rate.y, root = q * q - 4.0 * r * p, below = q + sqrt(max(root, 0.0));
        float way = p >= 0.0 ? 0.0 : root < 0.0 || below <= 0.0 ? INF : -2.0 * p / below;
        float slack = PIXEL * length(place) / focal;
        if (passed < 0.0)  // only beside the cell, by what a corner is drawn wrong
            way = length(place);
        else if (way <= passed || (way - passed) * length(along.xy) < slack)
            way += near;
        else if (p + passed * (q + passed * r) > -slack)
            way = near + passed;
        else  // above it all the way
            discard;
        at = clamp((along.xy * way - cell.xz) / extent, 0.0, 1.0);
        meet(way, normalize(vec3((vec2(north, east) + twist * at.yx) / extent, -1.0)), 0);
    }}
}}
""",
)

# The far sides of the bounding box of each sphere, cylinder or box: one fragment a pixel, also from inside.
SOLIDS = Program(
    f"""{_PROJECTION}
in vec3 corner;      // of the box, 0 or 1
in vec3 position;
in mat3 turn;        // into the solid's axes
in vec3 low, high;   // of its box, in those
in vec3 kind;        // radius, kind, and what it is
flat out vec3 at, least, most, about;
flat out mat3 back;
void main() {{
    at = -(turn * position), least = low, most = high, about = kind;
    back = transpose(turn);
    gl_Position = projected(position + back * mix(low, high, corner));
}}
""",
    f"""{_RAY}
flat in vec3 at, least, most, about;
flat in mat3 back;
void main() {{
    vec3 along = ray() * back, out_of = -along;
    float near = 0.0, far = reach;
    for (int i = 0; i < 3; i++) {{
        float rate = abs(along[i]) < TINY ? TINY : along[i];
        float one = (least[i] - at[i]) / rate, other = (most[i] - at[i]) / rate;
        if (min(one, other) > near) {{
            near = min(one, other);
            out_of = vec3(0.0);
            out_of[i] = -sign(rate);
        }}
        far = min(far, max(one, other));
    }}
    if (int(about.y) != {BOX}) {{  // from the place nearest to the middle or axis, which loses no digits
        vec3 axes = vec3(1.0, 1.0, int(about.y) == {SPHERE} ? 1.0 : 0.0), way = along * axes, from = at * axes;
        float rate = dot(way, way) + TINY, middle = -dot(from, way) / rate;
        vec3 closest = from + middle * way;
        float root = (about.x * about.x - dot(closest, closest)) / rate;
        if (root < 0.0)
            discard;
        if (middle - sqrt(root) > near) {{
            near = middle - sqrt(root);
            out_of = (from + near * way) / about.x;
        }}
        far = min(far, middle + sqrt(root));
    }}
    if (near > far)
        discard;
    meet(near, back * out_of, int(about.z));
}}
""",
)

MESH = Program(
    f"""{_PROJECTION}
uniform vec3 position;
uniform mat3 turn;  // into the world's axes
in vec3 corner, normal;
in vec2 along;      // m along both sides of the triangle at its first corner
flat out vec3 place, out_of;
out vec2 spot;
void main() {{
    spot = along;
    place = position + turn * corner;
    out_of = turn * normal;
    gl_Position = projected(place);
}}
""",
    f"""{_RAY}
uniform int number;
uniform vec2 net;   // m from twine to twine, and how thick one is; 0 for what is tight
flat in vec3 place, out_of;
in vec2 spot;
void main() {{
    if (net.x > 0.0 && all(lessThan(abs(fract(spot / net.x) - 0.5), vec2(0.5 - 0.5 * net.y / net.x))))
        discard;
    float rate = dot(out_of, ray());
    meet(dot(out_of, place) / rate, rate > 0.0 ? -out_of : out_of, number);
}}
""",
)
