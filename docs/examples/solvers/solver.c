/* Time stepping of planar mechanisms with dry friction. Build: cc -O2 -o solver solver.c -lm

   Moreau's midpoint rule. In a step of length h from (q, v), with m = q + h v/2 and p = q + h v, the next velocity w and
   the impulses L of joints and drives and P of friction solve
       M (w - v) = h Q(t + h/2, m, v) + J(m)' L + T(m)' P,   J(p) w = -dPhi/dt - Phi(q) / (10 h),   |P| <= mu load,
   load of the corners of a slider: max(|R|, 2 |N| / length) of its own impulses L;   q <- q + h (v + w) / 2. */
#include "scene.h"

enum { MAX = 120, GUIDES = 8 };

/* A coordinate between two bodies (angle, distance, distance along an axis of the second); what follows it or acts along it. */
typedef struct { int body[2], angle, along; double point[2][2], axis[2]; Law law; double stiffness, damping, rest; } Coordinate;
typedef struct { Coordinate slip; int normal; double mu, mus, length, width; const char *name; } Guide;
typedef struct { int body, torque; double point[2], direction[2]; Law law; } Load;
static int n, rows, springs, loads, guides;
static double mass[MAX], q[MAX], v[MAX], gravity[2];
static Coordinate row[MAX], spring[MAX];
static Guide guide[GUIDES];
static Load load[MAX];
static const char *bodies;

static int place(const char *name) {  /* of a body among the coordinates; -1: ground */
    for (int i = 0; 3 * i < n; i++) if (skip(name) - name == skip(item(bodies, i)) - item(bodies, i) && !strncmp(name, item(bodies, i), skip(name) - name)) return 3 * i;
    return -1;
}
static void turn(double angle, const double *point, double *to) {
    to[0] = cos(angle) * point[0] - sin(angle) * point[1], to[1] = sin(angle) * point[0] + cos(angle) * point[1];
}
static double coordinate(const Coordinate *c, const double *at, double *row) {  /* value, and derivatives by at */
    static const double ground[3];
    const double *a = c->body[0] < 0 ? ground : at + c->body[0], *b = c->body[1] < 0 ? ground : at + c->body[1];
    double arm[2], own[2], e[2], part[2][3] = {{0, 0, 1}, {0, 0, -1}}, found = a[2] - b[2];
    if (!c->angle) {
        turn(a[2], c->point[0], arm), turn(b[2], c->point[1], own);
        double there[2] = {a[0] + arm[0] - b[0], a[1] + arm[1] - b[1]}, between[2] = {there[0] - own[0], there[1] - own[1]};
        if (c->along) turn(b[2], c->axis, e); else memcpy(e, between, sizeof e);
        double size = hypot(e[0], e[1]);
        for (int k = 0; k < 2; k++) part[1][k] = -(part[0][k] = e[k] /= size > 0 ? size : 1);
        part[0][2] = arm[0] * e[1] - arm[1] * e[0], part[1][2] = there[1] * e[0] - there[0] * e[1];
        found = e[0] * between[0] + e[1] * between[1];
    }
    memset(row, 0, n * sizeof *row);
    for (int i = 0; i < 2; i++) if (c->body[i] >= 0) memcpy(row + c->body[i], part[i], sizeof part[i]);
    return found;
}
static Coordinate between(const char *one, const char *other, const char *point, const char *second, const char *axis) {
    Coordinate c = {{place(one), place(other)}, point == 0, axis && !null(axis)};
    if (point) pair(point, c.point[0]), pair(second, c.point[1]);
    if (c.along) pair(axis, c.axis);
    return c;
}
static Coordinate element(const char *json, int angle) {
    const char *ends = get(json, "bodies"), *points = angle ? 0 : get(json, "points");
    return between(item(ends, 0), item(ends, 1), angle ? 0 : item(points, 0), angle ? 0 : item(points, 1), angle ? 0 : get(json, "axis"));
}
static void constrain(Coordinate c, Law law) { if (rows >= MAX / 2) stop(77, "too many joints"); c.law = law, row[rows++] = c; }

static void read_scene(const char *scene) {
    const char *one;
    bodies = get(scene, "bodies"), pair(get(scene, "gravity"), gravity);
    for (int i = 0; (one = value(bodies, i)); i++, n += 3) {
        if (n > MAX / 2 - 3) stop(77, "too many bodies");
        mass[n] = mass[n + 1] = number(one, "mass"), mass[n + 2] = number(one, "inertia");
        pair(get(one, "position"), q + n), q[n + 2] = number(one, "angle");
        pair(get(one, "velocity"), v + n), v[n + 2] = number(one, "angular_velocity");
    }
    for (int i = 0; (one = value(get(scene, "joints"), i)); i++)
        if (is(get(one, "type"), "revolute")) {
            const char *ends = get(one, "bodies"), *points = get(one, "points");
            for (int k = 0; k < 2; k++) constrain(between(item(ends, 0), item(ends, 1), item(points, 0), item(points, 1), k ? "[0, 1]" : "[1, 0]"), constant(0));
        } else {
            Coordinate slip = between(get(one, "slider"), get(one, "guide"), get(one, "slider_point"), get(one, "point"), get(one, "direction")), normal = slip, turned = slip;
            Guide g = {slip, rows, 0, 0, 0, 0, item(get(scene, "joints"), i)};
            normal.axis[0] = -slip.axis[1], normal.axis[1] = slip.axis[0], turned.angle = 1;
            constrain(normal, constant(0)), constrain(turned, constant(number(one, "angle")));
            if (null(get(one, "mu"))) continue;
            g.mu = number(one, "mu"), g.mus = number(one, "mus");
            if (!null(get(one, "length"))) g.length = number(one, "length"), g.width = number(one, "width");
            if (guides >= GUIDES) stop(77, "too many guides");
            guide[guides++] = g;
        }
    for (int i = 0; (one = value(get(scene, "drives"), i)); i++) constrain(element(one, is(get(one, "type"), "angle")), read_law(get(one, "law")));
    for (int i = 0; (one = value(get(scene, "springs"), i)); i++) {
        int angle = is(get(one, "type"), "torsional");
        if (springs >= MAX) stop(77, "too many springs");
        spring[springs] = element(one, angle), spring[springs].stiffness = number(one, "stiffness");
        spring[springs].damping = number(one, "damping"), spring[springs++].rest = number(one, angle ? "rest_angle" : "rest_length");
    }
    for (int i = 0; (one = value(get(scene, "forces"), i)); i++) {
        if (loads >= MAX) stop(77, "too many forces");
        Load *l = &load[loads++];
        l->body = place(get(one, "body")), l->law = read_law(get(one, "law")), l->torque = is(get(one, "type"), "torque");
        if (!l->torque) pair(get(one, "point"), l->point), pair(get(one, "direction"), l->direction);
    }
}
static double dot(const double *a, const double *b) { double sum = 0; for (int i = 0; i < n; i++) sum += a[i] * b[i]; return sum; }
static void forces(double t, const double *at, const double *v, double *Q) {
    double e[MAX], arm[2], rate;
    for (int i = 0; i < n; i++) Q[i] = i % 3 < 2 ? mass[i] * gravity[i % 3] : 0;
    for (int k = 0; k < springs; k++) {
        double d = coordinate(&spring[k], at, e), pull = spring[k].stiffness * (d - spring[k].rest) + spring[k].damping * dot(e, v);
        for (int i = 0; i < n; i++) Q[i] -= pull * e[i];
    }
    for (const Load *l = load; l < load + loads; l++) {
        double size = law_at(&l->law, t, &rate), x = l->direction[0], y = l->direction[1];
        if (l->torque) { Q[l->body + 2] += size; continue; }
        turn(at[l->body + 2], l->point, arm), size /= hypot(x, y);
        Q[l->body] += size * x, Q[l->body + 1] += size * y, Q[l->body + 2] += size * (arm[0] * y - arm[1] * x);
    }
}
static void solve(double A[MAX][MAX + GUIDES + 1], int size, int sides) {  /* Gauss-Jordan; solutions behind the columns */
    for (int k = 0; k < size; k++) {
        int best = k;
        for (int i = k; i < size; i++) if (fabs(A[i][k]) > fabs(A[best][k])) best = i;
        if (fabs(A[best][k]) < 1e-13) stop(77, "constraints that depend on each other: a singular matrix");
        for (int j = k; j < size + sides; j++) { double x = A[k][j]; A[k][j] = A[best][j], A[best][j] = x; }
        for (int j = size + sides - 1; j >= k; j--) A[k][j] /= A[k][k];
        for (int i = 0; i < size; i++) if (i != k && A[i][k] != 0) for (int j = size + sides - 1; j >= k; j--) A[i][j] -= A[i][k] * A[k][j];
    }
}
static double bound(const Guide *g, double mu, double sign, double R, double N) {  /* mu times the load of the corners */
    return mu * (g->length > 0 ? fmax(fabs(R), 2 * fabs(N - g->width / 2 * sign * mu * R) / g->length) : fabs(R));
}
static void step(double t, double h, double *w, double *P) {  /* velocity after a step, and its friction impulses */
    static double A[MAX][MAX + GUIDES + 1];
    double middle[MAX], ahead[MAX], Q[MAX], e[MAX], T[GUIDES][MAX], S[GUIDES][MAX], x[MAX], unit[GUIDES][MAX], rate;
    int size = n + rows;
    for (int i = 0; i < n; i++) middle[i] = q[i] + h / 2 * v[i], ahead[i] = q[i] + h * v[i];
    forces(t + h / 2, middle, v, Q);
    for (int i = 0; i < size; i++) memset(A[i], 0, sizeof A[i]);
    for (int i = 0; i < n; i++) A[i][i] = mass[i], A[i][size] = mass[i] * v[i] + h * Q[i];
    for (int r = 0; r < rows; r++) {
        coordinate(&row[r], middle, e);
        for (int i = 0; i < n; i++) A[i][n + r] = -e[i];
        double error = coordinate(&row[r], q, e) - law_at(&row[r].law, t, &rate);
        coordinate(&row[r], ahead, e), law_at(&row[r].law, t + h, &rate);
        memcpy(A[n + r], e, n * sizeof *e), A[n + r][size] = rate - error / (10 * h);
    }
    for (int k = 0; k < guides; k++) {
        coordinate(&guide[k].slip, middle, T[k]), coordinate(&guide[k].slip, ahead, S[k]), P[k] = 0;
        for (int i = 0; i < n; i++) A[i][size + 1 + k] = T[k][i];
    }
    solve(A, size, 1 + guides);
    for (int i = 0; i < size; i++) { x[i] = A[i][size]; for (int k = 0; k < guides; k++) unit[k][i] = A[i][size + 1 + k]; }
    for (int turn = 0, moved = 1; turn < 200 && moved; turn++)  /* a friction changes loads, other guides' too */
        for (int k = moved = 0; k < guides; k++) {
            const Guide *g = &guide[k];
            double gain = dot(S[k], unit[k]), held = P[k] - dot(S[k], x) / gain, sign = held < 0 ? -1 : 1;  /* held: ends the slip */
            double *Rk = unit[k] + n + g->normal, *R = x + n + g->normal, most = bound(g, g->mu, sign, R[0], R[1]);
            double found = fmax(-most, fmin(most, held)), was = dot(T[k], v), will = gain * (found - held), more = held - P[k];
            if ((fabs(was) < 1e-9 || was * will <= 0)  /* at rest, or through rest: it holds if its own load lets it */
                && fabs(held) <= bound(g, g->mus, sign, R[0] + more * Rk[0], R[1] + more * Rk[1])) found = held;
            moved |= fabs(found - P[k]) > 1e-12 * fabs(found);
            for (int i = 0; i < size; i++) x[i] += (found - P[k]) * unit[k][i];
            P[k] = found;
        }
    memcpy(w, x, n * sizeof *w);
}
int main(int argc, char **argv) {
    if (argc == 2 && !strcmp(argv[1], "--version")) return puts("c-example 1.0"), 0;
    if (argc != 5) stop(2, "expected SCENE RESULT DT OUTPUT_STEP");
    FILE *file = fopen(argv[1], "rb"), *out = fopen(argv[2], "w");
    if (!file || !out) stop(1, "files cannot be opened");
    char *text = calloc(1, 1 << 23);
    if (fread(text, 1, (1 << 23) - 1, file) == (1 << 23) - 1) stop(77, "a scene of more than 8 MiB");
    const char *scene = get(text, "scene"), *labels[] = {"x", "y", "angle", "vx", "vy", "omega", "ax", "ay", "alpha"};
    read_scene(scene);
    double end = number(scene, "t_end"), w[MAX], P[GUIDES], last[MAX + GUIDES], now[MAX + GUIDES];
    long steps = fmax(1, round(end / strtod(argv[3], 0))), every = fmax(1, floor(strtod(argv[4], 0) / (end / steps) + 1e-9));
    double h = end / steps;
    fprintf(out, "t");
    for (int k = 0; k < 9; k += 3) for (int i = 0; i < n; i++) { const char *name = item(bodies, i / 3); fprintf(out, ",%.*s.%s", (int)(skip(name) - name - 2), name + 1, labels[k + i % 3]); }
    for (int k = 0; k < guides; k++) fprintf(out, ",%.*s.friction", (int)(skip(guide[k].name) - guide[k].name - 2), guide[k].name + 1);
    for (long k = 0; k <= steps; k++) {
        step(k * h, h, w, P);
        for (int i = 0; i < n + guides; i++) now[i] = i < n ? (w[i] - v[i]) / h : P[i - n] / h;
        if (k % every == 0 || k == steps) {
            fprintf(out, "\n%.17g", k * h);
            for (int i = 0; i < 2 * n; i++) fprintf(out, ",%.17g", i < n ? q[i] : v[i - n]);
            for (int i = 0; i < n + guides; i++) fprintf(out, ",%.17g", k ? (now[i] + last[i]) / 2 : now[i]);  /* of both sides */
        }
        for (int i = 0; i < n; i++) q[i] += h / 2 * (v[i] + w[i]), v[i] = w[i];
        memcpy(last, now, sizeof now);
    }
    return fprintf(out, "\n") < 0 || fclose(out) ? 1 : 0;
}
