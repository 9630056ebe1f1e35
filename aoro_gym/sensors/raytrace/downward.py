"""Device code: heights by rays down on triangles."""

# Device code: its types are Warp's, not Python's.
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportAssignmentType=false
import warp as wp

DEEP = wp.constant(1.0e4)  # [m] that a ray goes down: more than any terrain's relief


@wp.kernel(enable_backward=False)
def look_down(
    mesh: wp.uint64,
    frames: wp.array(dtype=wp.vec4),  # x, y, z [m] and heading [rad] of each machine
    points: wp.array(dtype=wp.vec2),  # forward and left [m]
    above: float,  # [m] that rays begin above the machines
    heights: wp.array2d(dtype=float),
):
    """Height [m] of a point of a machine's grid over the machine; NaN: there is nothing."""
    machine, k = wp.tid()
    frame = frames[machine]
    c = wp.cos(frame[3])
    s = wp.sin(frame[3])
    x = frame[0] + c * points[k][0] - s * points[k][1]
    y = frame[1] + s * points[k][0] + c * points[k][1]
    z = frame[2] + above
    heights[machine, k] = wp.nan
    hit = wp.mesh_query_ray(mesh, wp.vec3(x, y, z), wp.vec3(0.0, 0.0, -1.0), DEEP)
    if hit.result:
        heights[machine, k] = above - hit.t
