/* The slider-bar of the catalogue with its one freedom x, as an FMU: FMI 2 model exchange, or with -DSTEPS FMI 3 co-simulation.

   th = w0 t, c = m1 L/2, m = m1 + m2.  m x'' = P + phi N,  P = F0 sin(Omega t) - k (x - L0) + c w0^2 cos th,  phi = -+mu in slip,
   N = max(|R|, |D|),  R = m g - c w0^2 sin th,  D = 2/length (c (g cos th - x'' sin th) - width/2 phi R).
   -DFAILURE=1 ends the process after 0.5 s, 2 crashes, 3 is an error with a message, 4 discards, 5 ends the run. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifndef FAILURE
#define FAILURE 0
#endif
enum { F0, L, w0, g, m1, m2, k, L0, Omega, mu, mus, PARAMETERS, X = PARAMETERS, V, OUT, OUTPUTS = 21 };
static const double length = 0.6, width = 0.5;
typedef struct { double p[PARAMETERS], t, x, v, longest; int mode; void *environment; void *log; } Model;

static double c(const Model *m) { return m->p[m1] * m->p[L] / 2; }
static double mass(const Model *m) { return m->p[m1] + m->p[m2]; }
static double theta(const Model *m) { return m->p[w0] * m->t; }
static double push(const Model *m) {
    const double *p = m->p;
    return p[F0] * sin(p[Omega] * m->t) - p[k] * (m->x - p[L0]) + c(m) * p[w0] * p[w0] * cos(theta(m));
}
static double normal(const Model *m) { return mass(m) * m->p[g] - c(m) * m->p[w0] * m->p[w0] * sin(theta(m)); }
static double moment(const Model *m, double a) { return c(m) * (m->p[g] * cos(theta(m)) - a * sin(theta(m))); }
static double difference(const Model *m, double a, double phi) { return 2 / length * (moment(m, a) - width / 2 * phi * normal(m)); }
static double load(const Model *m, double a, double phi) { return fmax(fabs(normal(m)), fabs(difference(m, a, phi))); }

static double slipping(const Model *m, double phi) {  /* x'': of the linear equations the one whose N is the load */
    double A = difference(m, 0, phi), B = 2 / length * c(m) * sin(theta(m)), best = 0, least = INFINITY;
    for (int sign = -1; sign <= 1; sign++) {
        double a = sign ? (push(m) + phi * sign * A) / (mass(m) + phi * sign * B) : (push(m) + phi * fabs(normal(m))) / mass(m);
        double off = fabs(load(m, a, phi) - (sign ? sign * (A - B * a) : fabs(normal(m))));
        if (off < least) least = off, best = a;
    }
    return best;
}
static double excess(const Model *m, int *direction) {  /* of the push over static friction at rest */
    double most = -INFINITY;
    for (int s = -1; s <= 1; s += 2) {
        double found = s * push(m) - m->p[mus] * load(m, 0, -m->p[mus] * s);
        if (found > most) most = found, *direction = s;
    }
    return most;
}
static void settle(Model *m) {  /* at rest: stick, or slip where the push leads */
    int direction = 0;
    m->v = 0, m->mode = excess(m, &direction) > 0 ? direction : 0;
}
static double acceleration(const Model *m) { return m->mode ? slipping(m, -m->p[mu] * m->mode) : 0; }
static double get(Model *m, unsigned reference) {
    if (reference < PARAMETERS) return m->p[reference];
    if (reference == X) return m->x;
    if (reference == V) return m->v;
    double a = acceleration(m), th = theta(m), r = m->p[L] / 2, w = m->p[w0], C = cos(th), S = sin(th);
    double friction = m->mode ? -m->p[mu] * m->mode * load(m, a, -m->p[mu] * m->mode) : -push(m);
    const double all[OUTPUTS] = {m->x + r * C, r * S, th, m->v - r * w * S, r * w * C, w, a - r * w * w * C, -r * w * w * S, 0,
                                 m->x, 0, 0, m->v, 0, 0, a, 0, 0, friction, m->mode, th * 45 / atan(1)};
    return all[reference - OUT];
}
static void *made(void *environment, void *log) {
    Model *m = calloc(1, sizeof *m);
    m->environment = environment, m->log = log;
    return m;
}
static int set(Model *m, const unsigned *references, size_t n, const double *values) {
    for (size_t i = 0; i < n; i++) if (references[i] < PARAMETERS) m->p[references[i]] = values[i]; else return 3;
    m->x = m->p[L0];
    return 0;
}
static int failure(Model *m) {  /* status of a call after 0.5 s */
    if (!FAILURE || m->t < 0.5) return 0;
    if (FAILURE == 1) exit(3);
    if (FAILURE == 2) abort();
    return FAILURE == 3 ? 3 : FAILURE == 4 ? 2 : 0;
}

#define ABSENT(name) int name(void) { return 3; }
#ifndef STEPS
typedef void (*Log)(void *, const char *, int, const char *, const char *, ...);
typedef struct { Log log; void *rest[3]; void *environment; } Callbacks;
typedef struct { int again, end, nominals, values, timed; double next; } EventInfo;

void *fmi2Instantiate(const char *n, int kind, const char *id, const char *where, const Callbacks *calls, int visible, int log) {
    return made(calls->environment, (void *)calls->log);
}
void fmi2FreeInstance(void *m) { free(m); }
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
int fmi2SetupExperiment(void *m, int has, double rtol, double start, int ends, double stop) { return 0; }
int fmi2EnterInitializationMode(void *m) { return 0; }
int fmi2ExitInitializationMode(void *m) { settle(m); return 0; }
int fmi2EnterEventMode(void *m) { return 0; }
int fmi2EnterContinuousTimeMode(void *m) { return 0; }
int fmi2Terminate(void *m) { return 0; }
int fmi2SetReal(void *m, const unsigned *r, size_t n, const double *v) { return set(m, r, n, v); }
int fmi2GetReal(void *m, const unsigned *r, size_t n, double *v) { for (size_t i = 0; i < n; i++) v[i] = get(m, r[i]); return 0; }
int fmi2SetTime(void *m, double t) { ((Model *)m)->t = t; return 0; }
int fmi2SetContinuousStates(void *self, const double *x, size_t n) { Model *m = self; m->x = x[0], m->v = x[1]; return 0; }
int fmi2GetContinuousStates(void *self, double *x, size_t n) { Model *m = self; x[0] = m->x, x[1] = m->v; return 0; }
int fmi2GetNominalsOfContinuousStates(void *m, double *x, size_t n) { x[0] = x[1] = 1; return 0; }
int fmi2GetDerivatives(void *self, double *x, size_t n) {
    Model *m = self;
    int status = failure(m);
    if (status == 3) ((Log)m->log)(m->environment, "slider-bar", 3, "error", "the %s has come off at t = %.1f s", "bar", m->t);
    x[0] = m->mode ? m->v : 0, x[1] = acceleration(m);
    return status;
}
int fmi2GetEventIndicators(void *self, double *z, size_t n) {
    Model *m = self;
    int direction;
    z[0] = m->mode ? m->mode * m->v : -excess(m, &direction), z[1] = 1;
    if (m->mode) z[1] = fabs(normal(m)) - fabs(difference(m, acceleration(m), -m->p[mu] * m->mode));
    return 0;
}
int fmi2NewDiscreteStates(void *self, EventInfo *info) {
    Model *m = self;
    int was = m->mode, direction;
    memset(info, 0, sizeof *info);
    if (was ? was * m->v <= 1e-12 : excess(m, &direction) >= 0) settle(m), info->values = 1;
    if (!was && info->values) m->mode = direction;
    info->end = FAILURE == 5 && m->t > 0.5;
    return 0;
}
ABSENT(fmi2CompletedIntegratorStep) ABSENT(fmi2DeSerializeFMUstate) ABSENT(fmi2FreeFMUstate) ABSENT(fmi2GetBoolean)
ABSENT(fmi2GetDirectionalDerivative) ABSENT(fmi2GetFMUstate) ABSENT(fmi2GetInteger) ABSENT(fmi2GetString) ABSENT(fmi2Reset)
ABSENT(fmi2SerializeFMUstate) ABSENT(fmi2SerializedFMUstateSize) ABSENT(fmi2SetBoolean) ABSENT(fmi2SetDebugLogging)
ABSENT(fmi2SetFMUstate) ABSENT(fmi2SetInteger) ABSENT(fmi2SetString)
#else
typedef void (*Log)(void *, int, const char *, const char *);

static void step(Model *m, double h) {  /* x'' of the middle, or the one that ends the slip if friction can give it */
    double end = m->t + h, v = m->v;
    m->t += h / 2, m->x += h / 2 * v;
    double held = -mass(m) * v / h - push(m), sign = held < 0 ? -1 : 1, most = v ? m->p[mu] : m->p[mus];
    double w = fabs(held) <= most * load(m, -v / h, sign * most) ? 0 : v + h * slipping(m, sign * m->p[mu]);
    m->x += h / 2 * w, m->t = end, m->v = w;
    if (w) m->mode = w > 0 ? 1 : -1; else settle(m);
}
void *fmi3InstantiateCoSimulation(const char *n, const char *id, const char *where, _Bool visible, _Bool log, _Bool events, _Bool early,
                                  const unsigned *needed, size_t count, void *environment, Log logger, void *update) {
    return made(environment, (void *)logger);
}
void fmi3FreeInstance(void *m) { free(m); }
const char *fmi3GetVersion(void) { return "3.0"; }
int fmi3EnterInitializationMode(void *m, _Bool has, double rtol, double start, _Bool ends, double stop) {
    ((Model *)m)->longest = has ? 100 * rtol : INFINITY;  /* of its own steps, s */
    return 0;
}
int fmi3ExitInitializationMode(void *m) { settle(m); return 0; }
int fmi3Terminate(void *m) { return 0; }
int fmi3SetFloat64(void *m, const unsigned *r, size_t n, const double *v, size_t nv) { return set(m, r, n, v); }
int fmi3GetFloat64(void *m, const unsigned *r, size_t n, double *v, size_t nv) { for (size_t i = 0; i < n; i++) v[i] = get(m, r[i]); return 0; }
int fmi3DoStep(void *self, double t, double h, _Bool keep, _Bool *event, _Bool *end, _Bool *early, double *last) {
    Model *m = self;
    *event = *early = 0, *end = FAILURE == 5 && t > 0.5;
    if (failure(m) == 3) return ((Log)m->log)(m->environment, 3, "error", "the bar has come off"), 3;
    if (failure(m) == 2) return 2;
    int steps = ceil(h / m->longest - 1e-9);
    steps = steps < 1 ? 1 : steps;
    for (int i = 0; i < steps; i++) step(m, h / steps);
    *last = t + h;
    return 0;
}
#define MANY(X) X(ActivateModelPartition) X(CompletedIntegratorStep) X(DeserializeFMUState) X(EnterConfigurationMode) X(EnterContinuousTimeMode) \
    X(EnterEventMode) X(EnterStepMode) X(EvaluateDiscreteStates) X(ExitConfigurationMode) X(FreeFMUState) X(GetAdjointDerivative) X(GetBinary) \
    X(GetBoolean) X(GetClock) X(GetContinuousStateDerivatives) X(GetContinuousStates) X(GetDirectionalDerivative) X(GetEventIndicators) \
    X(GetFMUState) X(GetFloat32) X(GetInt16) X(GetInt32) X(GetInt64) X(GetInt8) X(GetIntervalDecimal) X(GetIntervalFraction) \
    X(GetNominalsOfContinuousStates) X(GetNumberOfContinuousStates) X(GetNumberOfEventIndicators) X(GetNumberOfVariableDependencies) \
    X(GetOutputDerivatives) X(GetShiftDecimal) X(GetShiftFraction) X(GetString) X(GetUInt16) X(GetUInt32) X(GetUInt64) X(GetUInt8) \
    X(GetVariableDependencies) X(InstantiateModelExchange) X(InstantiateScheduledExecution) X(Reset) X(SerializeFMUState) \
    X(SerializedFMUStateSize) X(SetBinary) X(SetBoolean) X(SetClock) X(SetContinuousStates) X(SetDebugLogging) X(SetFMUState) X(SetFloat32) \
    X(SetInt16) X(SetInt32) X(SetInt64) X(SetInt8) X(SetIntervalDecimal) X(SetIntervalFraction) X(SetShiftDecimal) X(SetShiftFraction) \
    X(SetString) X(SetTime) X(SetUInt16) X(SetUInt32) X(SetUInt64) X(SetUInt8) X(UpdateDiscreteStates)
#define ABSENT3(name) ABSENT(fmi3##name)
MANY(ABSENT3)
#endif
