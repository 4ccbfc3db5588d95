/* Reader of stiction's resolved scenes: JSON and laws of time. */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void stop(int code, const char *why) { fprintf(stderr, "%s\n", why); exit(code); }  /* 77: cannot represent it */

/* JSON without a tree: a value is a pointer to where it begins in the text. */
static const char *space(const char *p) { while (isspace((unsigned char)*p)) p++; return p; }
static const char *skip(const char *p) {  /* behind a value */
    int depth = 0;
    do {
        p = space(p);
        if (*p == '"') { for (p++; *p && *p != '"'; p++) if (*p == '\\') p++; p++; }
        else if (*p == '{' || *p == '[') depth++, p++;
        else if (*p == '}' || *p == ']') depth--, p++;
        else if (*p == ',' || *p == ':') p++;
        else p += strcspn(p, ",:]}{[\" \n\t\r");
    } while (depth > 0 && *p);
    return p;
}
static const char *item(const char *list, int k) {  /* of a list the value, of an object the name; 0 behind the last */
    const char *p = space(space(list) + 1);
    for (int object = *space(list) == '{'; *p != ']' && *p != '}'; p = space(p)) {
        if (k-- == 0) return p;
        p = skip(p);
        if (object) p = skip(space(p) + 1);
        if (*(p = space(p)) == ',') p++;
    }
    return 0;
}
static int is(const char *text, const char *word) { return !strncmp(text + 1, word, strlen(word)) && text[strlen(word) + 1] == '"'; }
static const char *get(const char *object, const char *key) {
    const char *name;
    for (int k = 0; (name = item(object, k)); k++) if (is(name, key)) return space(space(skip(name)) + 1);
    stop(1, key);
    return 0;
}
static const char *value(const char *object, int k) { const char *name = item(object, k); return name ? space(space(skip(name)) + 1) : 0; }
static double number(const char *object, const char *key) { return strtod(get(object, key), 0); }
static int null(const char *p) { return *p == 'n'; }
static void pair(const char *list, double *xy) { for (int k = 0; k < 2; k++) xy[k] = strtod(item(list, k), 0); }

/* laws of time */

typedef struct { char kind; double a, b, c, d; int n; double *x, *y, *bend; } Law;
static Law constant(double value) { Law law = {'c', value}; return law; }
static double *numbers(const char *list, int n) {
    double *found = malloc(n * sizeof *found);
    for (char *p = (char *)space(list) + 1; n-- > 0; p = (char *)space(p) + 1) *found++ = strtod(p, &p);
    return found;
}
static Law read_law(const char *json) {
    Law law = {get(json, "type")[1]};
    if (law.kind == 'c') law.a = number(json, "value");
    if (law.kind == 'l') law.a = number(json, "offset"), law.b = number(json, "rate");
    if (law.kind == 's') law.a = number(json, "offset"), law.b = number(json, "amplitude"), law.c = number(json, "frequency"), law.d = number(json, "phase");
    if (law.kind != 't') return law;
    while (item(get(json, "times"), law.n)) law.n++;
    int n = law.n, cubic = is(get(json, "interpolation"), "cubic");
    double *x = law.x = numbers(get(json, "times"), n) - n, *y = law.y = numbers(get(json, "values"), n) - n, *up = calloc(n, sizeof *up);
    law.b = cubic, law.bend = calloc(n, sizeof *up);  /* natural cubic spline: a tridiagonal system, first down, then up */
    for (int i = 1; i < n - 1 && cubic; i++) {
        double left = x[i] - x[i - 1], right = x[i + 1] - x[i], pivot = 2 * (left + right) - left * up[i - 1];
        up[i] = right / pivot;
        law.bend[i] = (6 * ((y[i + 1] - y[i]) / right - (y[i] - y[i - 1]) / left) - left * law.bend[i - 1]) / pivot;
    }
    for (int i = n - 2; i > 0; i--) law.bend[i] -= up[i] * law.bend[i + 1];
    return law;
}
static double law_at(const Law *law, double t, double *rate) {  /* value and rate */
    *rate = law->kind == 'l' ? law->b : law->kind == 's' ? law->b * law->c * cos(law->c * t + law->d) : 0;
    if (law->kind != 't') return law->kind == 's' ? law->a + law->b * sin(law->c * t + law->d) : law->a + *rate * t;
    int i = 0, n = law->n;
    const double *x = law->x, *y = law->y, *b = law->bend;
    while (i < n - 2 && t >= x[i + 1]) i++;
    double h = x[i + 1] - x[i], slope = (y[i + 1] - y[i]) / h, u = t - x[i], s = x[i + 1] - t;
    if (t < x[0] || t >= x[n - 1]) {  /* the end value, or the end's tangent */
        int k = t < x[0] ? 0 : n - 1;
        *rate = law->b ? slope + h / 6 * (k ? b[n - 2] + 2 * b[n - 1] : -2 * b[0] - b[1]) : 0;
        return y[k] + *rate * (t - x[k]);
    }
    *rate = (b[i + 1] * u * u - b[i] * s * s) / (2 * h) + slope - h / 6 * (b[i + 1] - b[i]);
    return (b[i] * s * s * s + b[i + 1] * u * u * u) / (6 * h) + (y[i] / h - b[i] * h / 6) * s + (y[i + 1] / h - b[i + 1] * h / 6) * u;
}
