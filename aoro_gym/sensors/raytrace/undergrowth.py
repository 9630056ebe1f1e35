"""Device code: how far a ray gets through undergrowth, a field of leaf area too fine for triangles.

A ray of length s through leaves that point anywhere is met by none with the probability exp(-∫ G u ds), Beer and Lambert's
law with the area u of leaves in a volume and G = 1/2 (Ross 1981, The Radiation Regime and Architecture of Plant Stands).
Where it is stopped is drawn by that law. What a leaf sends back comes through the gap that the ray came through, so light
is lost on the way there only.
"""

# Device code: its types are Warp's, not Python's.
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportAssignmentType=false
# ruff: noqa: UP018, RUF046
import warp as wp

PROJECTION = wp.constant(0.5)  # G of leaves that point anywhere
FACING = wp.constant(2.0 / 3.0)  # mean cosine at which such leaves are met: E[cos²] / E[cos]
STRIDE = wp.constant(0.05)  # [m] of the sum over a ray within the leaves
NEAR = wp.constant(0.02)  # [m] over the tallest leaves at which strides begin
MOST_STRIDES = wp.constant(4000)


@wp.struct
class Leaves:
    """Undergrowth on a grid; none where ``tallest`` is 0."""

    corner: wp.vec2  # [m] of the first node
    cell: float  # [m]
    tallest: float  # [m]
    steepest: float  # [-] rise of the ground between nodes
    nodes: wp.array2d(
        dtype=wp.vec3
    )  # ground [m], height over it [m], area of leaves in a volume, one side counted [1/m]
    kind: int  # class


@wp.func
def node(leaves: Leaves, x: float, y: float):
    """Ground, height over it and density at a place, between the nodes; no density off the grid."""
    u = (x - leaves.corner[0]) / leaves.cell
    v = (y - leaves.corner[1]) / leaves.cell
    rows = leaves.nodes.shape[0]
    columns = leaves.nodes.shape[1]
    i = wp.clamp(int(wp.floor(u)), 0, columns - 2)
    j = wp.clamp(int(wp.floor(v)), 0, rows - 2)
    a = wp.clamp(u - float(i), 0.0, 1.0)
    b = wp.clamp(v - float(j), 0.0, 1.0)
    south = wp.lerp(leaves.nodes[j, i], leaves.nodes[j, i + 1], a)
    out = wp.lerp(south, wp.lerp(leaves.nodes[j + 1, i], leaves.nodes[j + 1, i + 1], a), b)
    if u < 0.0 or v < 0.0 or u > float(columns - 1) or v > float(rows - 1):
        out[2] = 0.0
    return out


@wp.func
def to_next_cell(leaves: Leaves, place: wp.vec3, direction: wp.vec3):
    """Distance [m] along a ray to the next cell of the grid."""
    out = float(wp.inf)
    for axis in range(2):
        share = (place[axis] - leaves.corner[axis]) / leaves.cell
        share = share - wp.floor(share)
        if direction[axis] > 1.0e-6:
            out = wp.min(out, (1.0 - share) * leaves.cell / direction[axis])
        if direction[axis] < -1.0e-6:
            out = wp.min(out, share * leaves.cell / -direction[axis])
    return out


@wp.func
def stopped_at(leaves: Leaves, origin: wp.vec3, direction: wp.vec3, reach: float, chance: float, offset: float):
    """Distance [m] at which leaves stop a ray; infinite where none does before ``reach``.

    Args: origin [m] and unit direction; reach [m]; chance, uniform in (0, 1]: how deep it gets; offset, uniform in [0, 1):
    where the first stride begins, so that the sum is right in the mean however thin the leaves are.
    """
    deepest = -wp.log(chance)
    depth = float(0.0)
    t = float(0.0)
    over = bool(True)  # above the tallest leaves
    strides = int(0)
    while t < reach and strides < MOST_STRIDES:
        strides += 1
        place = origin + t * direction
        here = node(leaves, place[0], place[1])
        above = place[2] - here[0]
        if above > leaves.tallest + NEAR:  # nothing is met before ray and ground have come so much closer
            t += (above - leaves.tallest) / wp.max(leaves.steepest + wp.abs(direction[2]), 1.0e-3)
            over = True
        elif over:
            t += STRIDE * offset
            over = False
        elif here[2] == 0.0:  # none grows in this cell
            t += wp.max(to_next_cell(leaves, place, direction), 0.2 * STRIDE)
        else:
            if above < here[1] and above > -STRIDE:
                depth += PROJECTION * here[2] * STRIDE
                if depth >= deepest:
                    return t
            t += STRIDE
    return float(wp.inf)
