/* The time derivative of the states that plant.py names, with a fixed-step fourth-order Runge-Kutta rule.
   P_name (parameters), X_name (states), NX, NE come from a header written by fast.py. */
#include <math.h>
#include <string.h>
#define P(name) p[P_##name]
#define X(name) x[X_##name]
#define DX(name) dx[X_##name]
#define PI 3.14159265358979323846
static const double SPAN = PI / 3.0, FIT = 0.223, L0 = 0.2, D0 = 0.02;

static double dist(double a) { return hypot(0.0444 + 0.032 * cos(a), 0.416 - 0.032 * sin(a)); }
static double dist_slope(double a) {
    double u = 0.0444 + 0.032 * cos(a), v = 0.416 - 0.032 * sin(a);
    return 0.032 * (-u * sin(a) - v * cos(a)) / hypot(u, v);
}
static double pitch(void) { return L0 * tan(25.0 * PI / 180.0) / D0; }
static double vol(double s) {
    double b = L0 / cos(25.0 * PI / 180.0), d2 = (b * b - s * s) / (pitch() * pitch());
    double h = d2 > D0 * D0 ? 0.5 * sqrt(d2 - D0 * D0) : 1e-7;
    double zone = PI * h / 6.0 * (0.75 * d2 + 0.75 * D0 * D0 + h * h);
    return 0.25 * PI * d2 * (s - 2.0 * h) + 2.0 * zone;
}
static double vol_slope(double s) {
    double b = L0 / cos(25.0 * PI / 180.0), w2 = pitch() * pitch(), d2 = (b * b - s * s) / w2;
    double h = d2 > D0 * D0 ? 0.5 * sqrt(d2 - D0 * D0) : 0.0;
    return -0.5 * PI * s / w2 * (s - h) + 0.25 * PI * d2;
}
static double clamp0(double v, double w, double law) {
    if (law == 0) return 0.5 * (v + sqrt(v * v + w * w));
    if (law == 1) { double z = v / w; return z > 35 ? v : (z < -35 ? 0.0 : w * log1p(exp(z))); }
    return v > 0 ? v : 0.0;
}
static double opening(double v, const double *volts, const double *part, int n) {
    int i = 1;
    if (v <= 0) return 0.0;
    if (v >= volts[n - 1]) return part[n - 1];
    while (volts[i] < v) i++;
    return part[i-1] + (part[i] - part[i-1]) * (v - volts[i-1]) / (volts[i] - volts[i-1]);
}
static double oneway(const double *p, double c, double up, double down, double t) {
    double b = P(critical_ratio), rl = P(linear_ratio), r = down / up, psi = 1.0;
    if (r > b) {
        double rr = r <= rl ? r : rl, y = (rr - b) / (1.0 - b);
        psi = sqrt(1.0 - y * y);
        if (r > rl) psi *= (1.0 - r) / (1.0 - rl);
    }
    return c * P(reference_density) * up * sqrt(P(reference_temperature) / t) * psi;
}
static double flow(const double *p, double c, double pa, double ta, double pb, double tb,
                   double *carried) {
    if (pa >= pb) { *carried = ta; return oneway(p, c, pa, pb, ta); }
    *carried = tb;
    return -oneway(p, c, pb, pa, tb);
}
static double weight(const double *p, double a, double load) {
    double c = cos(a), s = sin(a);
    double moment = 0.987 * (0.205 * c - 0.0176 * s) + load * (0.367 * c + 0.024 * s);
    return -9.81 * (moment * P(vertical) + (0.987 * 0.205 + load * 0.367) * c * sin(P(tilt)));
}
static double fibre(const double *p, const double *x, int k) {
    if (P(tendon_stiffness) > 0) return x[X_fibre_1 + k];
    return dist(k ? SPAN - X(angle) : X(angle)) - FIT;
}
static void slip(const double *p, double *x, const double *old) {
    for (int k = 0; k < 2; k++) {
        double step = fibre(p, x, k) - fibre(p, old, k);
        for (int i = 0; i < NE; i++) {
            if (p[P_hyst_w1 + i] == 0) continue;
            double d = p[P_hyst_d1 + i], z = old[X_slip_1_1 + NE * k + i] + step;
            x[X_slip_1_1 + NE * k + i] = z > d ? d : (z < -d ? -d : z);
        }
    }
}
static double muscle(const double *p, double s, double gauge, double gain, double loop) {
    double q = (L0 - s) * 1e3, phi = -9.2101, raw;
    if (q > 1.757) phi = (((0.00045804 * q - 0.053424) * q + 2.0189) * q - 43.691) * q + 61.62;
    raw = (280.0 - 2.2 * q + 0.033 * q * q) * gauge * 1e-5 + phi;
    raw *= 1.0 + P(force_shape) * (q / 30.0) * (q / 30.0);
    gain *= P(force_gain);
    if (P(hyst_place) == 1) return clamp0(gain * raw + loop, P(slack_width), P(slack_law));
    return gain * clamp0(raw, P(slack_width), P(slack_law)) + loop;
}

static void derivative(const double *p, const double *x, double u, const double *volts,
                       const double *part, int n, double *dx) {
    double ten[2], lever[2], vv[2], dv[2], pr[2], tt[2], amb = P(ambient_pressure);
    double te = P(ambient_temperature), rt = P(gas_constant) * te, g1 = P(gamma) - 1.0;
    double cv = P(gas_constant) / g1, w = X(speed), tc;
    memset(dx, 0, NX * sizeof(double));
    for (int k = 0; k < 2; k++) {
        double a = k ? SPAN - X(angle) : X(angle), s = fibre(p, x, k), gauge, active, rate, loop;
        double share = 0, statics;
        lever[k] = (k ? -1.0 : 1.0) * dist_slope(a);
        rate = lever[k] * w;
        vv[k] = P(volume_gain) * vol(s) + P(dead_volume);
        pr[k] = g1 * x[X_energy_1 + 2 * k] / vv[k];
        tt[k] = x[X_energy_1 + 2 * k] / (x[X_mass_1 + 2 * k] * cv);
        gauge = active = pr[k] - amb;
        if (P(creep_fast) != 0 || P(creep_slow) != 0) {
            double f = x[X_creep_fast_1 + 2 * k], l = x[X_creep_slow_1 + 2 * k];
            active += P(creep_fast) * (f - gauge) + P(creep_slow) * (l - gauge);
            dx[X_creep_fast_1 + 2 * k] = (gauge - f) / P(creep_fast_time);
            dx[X_creep_slow_1 + 2 * k] = (gauge - l) / P(creep_slow_time);
        }
        if (P(hyst_law) == 1) share = x[X_memory_1 + k];
        for (int i = 0; i < NE; i++)
            share += p[P_hyst_w1 + i] * x[X_slip_1_1 + NE * k + i] / p[P_hyst_d1 + i];
        loop = (P(hyst_force) + P(hyst_slope) * (gauge > 0 ? gauge : 0) * 1e-5) * share
               * (k ? P(hyst_share_2) : 1.0);
        statics = muscle(p, s, active, p[P_force_gain_1 + k], loop);
        if (P(tendon_stiffness) > 0) {
            ten[k] = P(tendon_stiffness) * (dist(a) - FIT - s);
            if (ten[k] < 0) ten[k] = 0;
            rate = (ten[k] - statics) / P(muscle_viscosity);
            dx[X_fibre_1 + k] = rate;
        } else {
            ten[k] = statics + P(muscle_viscosity) * rate;
            if (P(tension_only) != 0 && ten[k] < 0) ten[k] = 0;
        }
        if (P(hyst_law) == 1) {
            double z = x[X_memory_1 + k], az = fabs(z), m = P(hyst_exponent);
            dx[X_memory_1 + k] = (rate - P(hyst_beta) * fabs(rate) * z * pow(az, m - 1.0)
                                  - (1.0 - P(hyst_beta)) * rate * pow(az, m)) / P(hyst_breakaway);
        }
        dv[k] = P(volume_gain) * vol_slope(s) * rate;
    }

    double y = X(spool), db = P(valve_deadband), up, down, supply = P(supply_pressure) + amb;
    if (db > 0) y = (y > db ? y - db : 0.0) + (y < -db ? y + db : 0.0);
    up = opening(y, volts, part, n);
    down = opening(-y, volts, part, n);
    if (P(supply_volume) > 0) {
        double inside = X(reservoir) * rt / P(supply_volume);
        DX(reservoir) = flow(p, P(supply_conductance), supply, te, inside, te, &tc);
        if (P(supply_linear) > 0) DX(reservoir) = P(supply_linear) * (supply - inside);
        supply = inside;
    }
    double between = 0, tb = te;
    if (P(leak_between) > 0) between = flow(p, P(leak_between), pr[0], tt[0], pr[1], tt[1], &tb);
    for (int k = 0; k < 2; k++) {
        double port = pr[k], tp = tt[k], outlet = amb, ti, to, win, wout, dm, heat;
        double fill = (k ? down : up) + P(centre_leakage), vent = (k ? up : down) + P(centre_leakage);
        if (k == 0) fill *= P(edge_supply_1);
        if (P(line_volume) > 0) { port = x[X_line_1 + k] * rt / P(line_volume); tp = te; }
        if (P(silencer_volume) > 0) outlet = x[X_exhaust_1 + k] * rt / P(silencer_volume);
        win = flow(p, P(conductance) * fill, supply, te, port, tp, &ti);
        wout = flow(p, P(conductance) * vent, port, tp, outlet, te, &to);
        if (P(supply_volume) > 0) DX(reservoir) -= win;
        if (P(silencer_volume) > 0)
            dx[X_exhaust_1 + k] = wout - flow(p, P(silencer_conductance), outlet, te, amb, te, &tc);
        dm = win - wout;
        heat = win * ti - wout * to;
        if (P(line_volume) > 0) {
            double thr = flow(p, P(line_conductance), port, tp, pr[k], tt[k], &tc);
            dx[X_line_1 + k] = win - wout - thr;
            dm = thr;
            heat = thr * tc;
        }
        if (p[P_leak_1 + k] > 0) {
            double lost = flow(p, p[P_leak_1 + k], pr[k], tt[k], amb, te, &tc);
            dm -= lost;
            heat -= lost * tc;
        }
        dm += k ? between : -between;
        heat += (k ? between : -between) * tb;
        if (P(net_enthalpy) == 1) heat = dm * (dm > 0 ? te : tt[k]);
        dx[X_mass_1 + 2 * k] = dm;
        if (P(polytropic) > 0)
            dx[X_energy_1 + 2 * k] = (P(polytropic) * pr[k] * (vv[k] * dm / x[X_mass_1 + 2 * k] - dv[k])
                                      + pr[k] * dv[k]) / g1;
        else
            dx[X_energy_1 + 2 * k] = P(gamma) * cv * heat - pr[k] * dv[k]
                                     - P(heat_transfer) * P(heat_area) * (tt[k] - te);
    }

    double target = u - P(valve_centre), w0 = 2.0 * PI * P(spool_frequency), sr = X(spool_speed), sa;
    if (target > 0) target *= P(valve_gain_up);
    sa = w0 * w0 * (target - X(spool)) - 2.0 * P(spool_damping) * w0 * sr;
    if (P(valve_slew) > 0) {
        double lim = P(valve_slew);
        if (fabs(sr) >= lim && sa * sr > 0) sa = 0;
        sr = sr > lim ? lim : (sr < -lim ? -lim : sr);
    }
    DX(spool) = sr;
    DX(spool_speed) = sa;

    double dry = P(coulomb) + P(load_friction) * (ten[0] + ten[1]), a = X(angle), tq, st = 0, jl;
    if (P(stribeck_torque) != 0) { double v = w / P(stribeck_speed); dry += P(stribeck_torque) * exp(-v * v); }
    tq = -ten[0] * lever[0] - ten[1] * lever[1] - P(viscous) * w - P(quadratic_drag) * w * fabs(w);
    if (P(lugre_stiffness) > 0) {
        DX(bristle) = w - P(lugre_stiffness) * fabs(w) * X(bristle) / dry;
        tq -= P(lugre_stiffness) * X(bristle) + P(lugre_damping) * DX(bristle);
    } else tq -= dry * tanh(w / P(coulomb_speed));
    if (a < 0) { st = -P(stop_stiffness) * a - P(stop_damping) * w; if (st < 0) st = 0; }
    if (a > SPAN) { st = -P(stop_stiffness) * (a - SPAN) - P(stop_damping) * w; if (st > 0) st = 0; }
    tq += st + P(constant_torque) + P(external_torque) - P(spring_torque) * (a - SPAN / 2);
    tq += P(pressure_torque) * pow((pr[0] - pr[1]) * 1e-5, 2);
    if (P(cogging_torque) != 0) tq += P(cogging_torque) * sin(P(cogging_periods) * a);
    jl = P(load) * P(load_inertia_per_kg);
    if (P(load_stiffness) > 0 && P(load) > 0) {
        double cpl = P(load_stiffness) * (a - X(load_angle)) + P(load_damping) * (w - X(load_speed));
        DX(load_angle) = X(load_speed);
        DX(load_speed) = (cpl + weight(p, X(load_angle), P(load)) - weight(p, X(load_angle), 0)) / jl;
        DX(speed) = (tq + weight(p, a, 0) - cpl) / P(arm_inertia);
    } else DX(speed) = (tq + weight(p, a, P(load))) / (P(arm_inertia) + jl);
    DX(angle) = w;
}

/* Advance x over n steps of dt, the command u[i] held during step i; every `keep` steps (before
   the step) the state is copied to out when out is not null. */
void rig_run(const double *p, double *x, const double *u, int n, double dt, const double *volts,
             const double *part, int knots, int keep, double *out) {
    double k1[NX], k2[NX], k3[NX], k4[NX], y[NX];
    int loops = 0;
    for (int i = 0; i < NE; i++) loops |= p[P_hyst_w1 + i] != 0;
    for (int j = 0; j < n; j++) {
        if (out && j % keep == 0) memcpy(out + (size_t)(j / keep) * NX, x, NX * sizeof(double));
        derivative(p, x, u[j], volts, part, knots, k1);
        for (int i = 0; i < NX; i++) y[i] = x[i] + 0.5 * dt * k1[i];
        if (loops) slip(p, y, x);
        derivative(p, y, u[j], volts, part, knots, k2);
        for (int i = 0; i < NX; i++) y[i] = x[i] + 0.5 * dt * k2[i];
        if (loops) slip(p, y, x);
        derivative(p, y, u[j], volts, part, knots, k3);
        for (int i = 0; i < NX; i++) y[i] = x[i] + dt * k3[i];
        if (loops) slip(p, y, x);
        derivative(p, y, u[j], volts, part, knots, k4);
        for (int i = 0; i < NX; i++) y[i] = x[i] + dt / 6.0 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
        if (loops) slip(p, y, x);
        memcpy(x, y, sizeof y);
    }
}
void rig_derivative(const double *p, const double *x, double u, const double *volts,
                    const double *part, int knots, double *dx) {
    derivative(p, x, u, volts, part, knots, dx);
}
