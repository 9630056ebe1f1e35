/* What of a machine follows from its parameters by more than one formula: how its cylinders are mounted, how it stands,
 * and whether its circuits are stable. The same arithmetic, in the same order, as in aoro_gym/machine/linkage.py,
 * aoro_gym/machine/rest.py and aoro_gym/twin/hydraulic_step.py, which say where it comes from. */

#ifndef AORO_CLOSURE_H
#define AORO_CLOSURE_H

#include <math.h>

#define PI 3.141592653589793

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

/* --- linkage of a cylinder --- */

struct linkage {
    double a, b;        /* [m] hinge to the pins */
    double g0;          /* [rad] angle between the radii at mid-range; NaN where there is no such linkage */
    double dead_length; /* [m] */
    double stroke;      /* [m] */
    double half_range;  /* [rad] */
    double mean_lever;  /* [m] stroke over the whole range */
};

static struct linkage close_linkage(double dead_length, double stroke, double ratio, double half_range)
{
    struct linkage out = {NAN, NAN, NAN, dead_length, stroke, half_range, stroke / (2.0 * half_range)};
    const double stretch = pow((dead_length + stroke) / dead_length, 2.0);
    const double cos_part = (stretch - 1.0) * cos(half_range);
    const double sin_part = (stretch + 1.0) * sin(half_range);
    const double cosine =
        (1.0 + ratio * ratio) * (stretch - 1.0) / (2.0 * ratio * hypot(cos_part, sin_part));
    const double middle = atan2(sin_part, cos_part);
    const double spread = acos(smaller(larger(cosine, -1.0), 1.0));
    double best = -INFINITY;
    for (int i = 0; i < 2; i++) {
        const double root = i == 0 ? middle - spread : middle + spread;
        const double first =
            dead_length / sqrt(1.0 + ratio * ratio - 2.0 * ratio * cos(root - half_range));
        const double shortest = ratio * (first * first) *
            smaller(sin(root - half_range) / dead_length, sin(root + half_range) / (dead_length + stroke));
        if (fabs(cosine) <= 1.0 && root > half_range && root < PI - half_range && shortest > best) {
            best = shortest;
            out.g0 = root;
            out.a = first;
        }
    }
    out.b = ratio * out.a;
    return out;
}

static double linkage_lever(const struct linkage *one, double angle)
{
    const double length = sqrt(pow(one->a, 2.0) + pow(one->b, 2.0) - 2.0 * one->a * one->b * cos(one->g0 + angle));
    return one->a * one->b * sin(one->g0 + angle) / length;
}

/* --- rest pose on level ground --- */

struct rest_inputs {
    double frame_front_mass, frame_front_axle_distance, frame_front_cog_offset;
    double frame_rear_mass, frame_rear_axle_distance, frame_rear_cog_offset;
    double corner_mass, corner_rho;
    double arm_length, arm_rest_angle, arm_pivot_height, arm_rod_rest_pressure, arm_cylinder_bore, arm_cylinder_rod;
    double tire_radius, tire_stiffness;
    struct linkage linkage;
    double gravity;
};

struct rest_pose {
    double height;                                 /* [m] */
    double arm_angle_front, arm_angle_rear;        /* [rad]; NaN where there is no such pose */
    double wheel_load_front, wheel_load_rear;      /* [N] */
    double deflection_front, deflection_rear;      /* [m] */
    double bore_pressure_front, bore_pressure_rear; /* [Pa] */
};

static double bore_pressure(const struct rest_inputs *in, double angle, double load)
{
    const double bore_area = PI / 4.0 * pow(in->arm_cylinder_bore, 2.0);
    const double annulus_area = PI / 4.0 * (pow(in->arm_cylinder_bore, 2.0) - pow(in->arm_cylinder_rod, 2.0));
    const double torque = (load * in->arm_length - in->gravity * in->corner_mass * in->corner_rho) * cos(angle);
    const double force = torque / linkage_lever(&in->linkage, -angle);
    return (force + in->arm_rod_rest_pressure * annulus_area) / bore_area;
}

static struct rest_pose find_rest(const struct rest_inputs *in)
{
    struct rest_pose out = {0};
    const double front = in->arm_rest_angle;
    const double pivot_front = in->frame_front_axle_distance - in->arm_length;
    const double pivot_rear = in->frame_rear_axle_distance - in->arm_length;
    const double cog_front = 1.0 * (in->frame_front_axle_distance - in->frame_front_cog_offset);
    const double cog_rear = -1.0 * (in->frame_rear_axle_distance - in->frame_rear_cog_offset);
    const double weight = in->gravity * (in->frame_front_mass + in->frame_rear_mass + 4.0 * in->corner_mass);
    double rear = front, pivots = NAN, reach = NAN, change = NAN;
    for (int i = 0; i < 100; i++) {
        const double wheel_front = pivot_front + in->arm_length * cos(front);
        const double wheel_rear = pivot_rear + in->arm_length * cos(rear);
        const double moment = in->gravity *
            (in->frame_front_mass * cog_front + in->frame_rear_mass * cog_rear +
             2.0 * in->corner_mass *
                 (pivot_front + in->corner_rho * cos(front) - pivot_rear - in->corner_rho * cos(rear)));
        out.wheel_load_front = 0.5 * (moment + weight * wheel_rear) / (wheel_front + wheel_rear);
        out.wheel_load_rear = 0.5 * weight - out.wheel_load_front;
        out.deflection_front = out.wheel_load_front / in->tire_stiffness;
        out.deflection_rear = out.wheel_load_rear / in->tire_stiffness;
        pivots = in->tire_radius - out.deflection_front - in->arm_length * sin(front);
        reach = (in->tire_radius - out.deflection_rear - pivots) / in->arm_length;
        const double previous = rear;
        rear = asin(smaller(larger(reach, -1.0), 1.0));
        change = fabs(rear - previous);
        if (change < 1e-14) break;
    }
    out.height = pivots - in->arm_pivot_height;
    out.arm_angle_front = front;
    out.arm_angle_rear = fabs(reach) < 1.0 && change < 1e-14 ? rear : NAN;
    out.bore_pressure_front = bore_pressure(in, out.arm_angle_front, out.wheel_load_front);
    out.bore_pressure_rear = bore_pressure(in, out.arm_angle_rear, out.wheel_load_rear);
    return out;
}

/* --- stability of the hydraulic circuits --- */

/* A restrictor of the given slope [m³/s/Pa] between two volumes, or between one and the tank (-1), in the circuit's
 * symmetric matrix (count, count); root: square roots of the volumes' stiffnesses. */
static void restrict_flow(double *matrix, const double *root, int count, int first, int second, double slope)
{
    matrix[first * count + first] += slope * (root[first] * root[first]);
    if (second < 0) return;
    matrix[second * count + second] += slope * (root[second] * root[second]);
    matrix[first * count + second] -= slope * root[first] * root[second];
    matrix[second * count + first] -= slope * root[first] * root[second];
}

/* Whether all eigenvalues of a symmetric matrix (count, count), which is overwritten, are below a bound: then and only
 * then bound I - matrix has a Cholesky factor. */
static int all_below(double *matrix, int count, double bound)
{
    for (int i = 0; i < count * count; i++) matrix[i] = (i % (count + 1) == 0 ? bound : 0.0) - matrix[i];
    for (int j = 0; j < count; j++) {
        for (int i = j; i < count; i++) {
            double sum = matrix[i * count + j];
            for (int k = 0; k < j; k++) sum -= matrix[i * count + k] * matrix[j * count + k];
            if (i == j) {
                if (!(sum > 0.0)) return 0;
                matrix[j * count + j] = sqrt(sum);
            } else {
                matrix[i * count + j] = sum / matrix[j * count + j];
            }
        }
    }
    return 1;
}

#endif
