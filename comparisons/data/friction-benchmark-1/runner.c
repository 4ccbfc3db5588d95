/* Runner of friction-benchmark 1: solves the scenes with your solver, and writes a submission.

   Write your solver into `simulate`, describe it in `about` and `settings`, and run

       cc -std=c99 -O2 -o runner runner.c -lm
       mkdir my-submission
       ./runner BENCHMARK my-submission

   with the folder of the benchmark. It needs a C99 compiler and nothing else. The folder my-submission must exist.
   As it is delivered, it solves the scene block-on-incline by a formula and declines all others. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A line of submission.toml; the value is the text or, if that is 0, the number. */
typedef struct {
    const char *key, *text;
    double number;
} Line;

static const Line about[] = {
    {"benchmark", "friction-benchmark 1", 0},
    {"who", "your name", 0},
    {"engine", "your solver", 0},
    {"version", "1.0", 0},
    {"fidelity", "joint", 0}, /* or "contact": see RULES.md */
    {"machine", "your machine", 0},
    {"command", "./runner friction-benchmark-1 my-submission", 0},
};
static const Line settings[] = {
    {"dt", 0, 0.001}, /* any keys, for example {"method", "Heun", 0} */
};

/* A value of a JSON file. The members of an object and the items of a list are a chain of `next`, which begins at
   `first`; a member has a `key`. */
typedef struct Json {
    enum { JSON_NULL, JSON_TRUE, JSON_FALSE, JSON_NUMBER, JSON_TEXT, JSON_LIST, JSON_OBJECT } type;
    double number;
    char *text;
    char *key;
    struct Json *first, *next;
} Json;

/* The value of a member of an object, or 0 if it has no such key or is null:
       const Json *slider = json_get(json_get(scene, "bodies"), "slider"); */
static const Json *json_get(const Json *object, const char *key) {
    const Json *member = object ? object->first : 0;
    while (member && (!member->key || strcmp(member->key, key) != 0)) member = member->next;
    return member && member->type != JSON_NULL ? member : 0;
}

/* A number of an object; `missing` if it has no such key or is null:
       double mass = json_number(slider, "mass", NAN); */
static double json_number(const Json *object, const char *key, double missing) {
    const Json *member = json_get(object, key);
    return member && member->type == JSON_NUMBER ? member->number : missing;
}

/* An item of a list of numbers, counted from 0:
       double y = json_item(json_get(slider, "position"), 1); */
static double json_item(const Json *list, int index) {
    const Json *item = list ? list->first : 0;
    while (item && index-- > 0) item = item->next;
    return item && item->type == JSON_NUMBER ? item->number : NAN;
}

/* Solve one scene: replace this function.

   name: name of the scene, such as "block-on-incline".
   scene: the mechanism, as in scene.json; description.txt explains the numbers.
   step: largest distance of the rows, s. The step of your solver may be smaller.
   table: file to write: a line with the names of the columns, for example "t,slider.x", and a line for each row.

   Return 0 or, if your solver cannot represent the scene, the reason as text; the table is then deleted. */
static const char *simulate(const char *name, const Json *scene, double step, FILE *table) {
    if (strcmp(name, "block-on-incline") != 0) return "not implemented yet";
    const Json *guide = json_get(json_get(scene, "joints"), "guide");
    const Json *slider = json_get(json_get(scene, "bodies"), "slider");
    const Json *direction = json_get(guide, "direction"), *gravity = json_get(scene, "gravity");
    double direction_x = json_item(direction, 0), direction_y = json_item(direction, 1);
    double gravity_x = json_item(gravity, 0), gravity_y = json_item(gravity, 1);
    double x = json_item(json_get(slider, "position"), 0), y = json_item(json_get(slider, "position"), 1);
    /* The weight along the guide, and the normal force, per mass; no corner lifts, so that the load of the friction
       is |normal|. */
    double pull = gravity_x * direction_x + gravity_y * direction_y;
    double normal = gravity_x * direction_y - gravity_y * direction_x;
    /* The slider is at rest at t = 0, and remains there unless the pull exceeds static friction. */
    double acceleration = 0;
    if (fabs(pull) > json_number(guide, "mus", NAN) * fabs(normal))
        acceleration = pull - copysign(json_number(guide, "mu", NAN) * fabs(normal), pull);
    long rows = lround(json_number(scene, "t_end", NAN) / step);
    fprintf(table, "t,slider.x,slider.y\n");
    for (long row = 0; row <= rows; row++) {
        double t = row * step, distance = acceleration * t * t / 2;
        fprintf(table, "%.17g,%.17g,%.17g\n", t, x + distance * direction_x, y + distance * direction_y);
    }
    return 0;
}

/* ---- The rest reads JSON and runs the scenes; it need not be changed. ---- */

static void stop(const char *message, const char *file) {
    fprintf(stderr, "%s: %s\n", message, file);
    exit(1);
}

static const char *skip_space(const char *text) { return text + strspn(text, " \t\r\n"); }

/* Copy a text in quotes without its escapes, of which the benchmark has only \" and \\; `*text` is moved behind it. */
static char *parse_text(const char **text) {
    const char *read = *text + 1;
    char *copy = malloc(strlen(read) + 1), *write = copy;
    while (*read && *read != '"') {
        if (*read == '\\') read++;
        *write++ = *read++;
    }
    *write = 0;
    *text = read + 1;
    return copy;
}

/* Read one value; `*text` is moved behind it. */
static Json *parse(const char **text) {
    Json *value = calloc(1, sizeof *value), **place = &value->first;
    *text = skip_space(*text);
    if (**text == '"') {
        value->type = JSON_TEXT;
        value->text = parse_text(text);
    } else if (**text == '{' || **text == '[') {
        char end = **text == '{' ? '}' : ']';
        value->type = end == '}' ? JSON_OBJECT : JSON_LIST;
        *text = skip_space(*text + 1);
        while (**text && **text != end) {
            char *key = 0;
            if (end == '}') {
                key = parse_text(text);
                *text = skip_space(*text) + 1; /* behind the colon */
            }
            *place = parse(text);
            (*place)->key = key;
            place = &(*place)->next;
            *text = skip_space(*text);
            if (**text == ',') *text = skip_space(*text + 1);
        }
        if (**text) ++*text;
    } else if (**text == 't' || **text == 'f' || **text == 'n') {
        value->type = **text == 't' ? JSON_TRUE : **text == 'f' ? JSON_FALSE : JSON_NULL;
        *text += strcspn(*text, ",]} \t\r\n");
    } else {
        char *end;
        value->type = JSON_NUMBER;
        value->number = strtod(*text, &end);
        if (end == *text) stop("no JSON", *text);
        *text = end;
    }
    return value;
}

static char *read_file(const char *file) {
    FILE *stream = fopen(file, "rb");
    if (!stream || fseek(stream, 0, SEEK_END)) stop("cannot be read", file);
    long size = ftell(stream);
    char *text = calloc((size_t)size + 1, 1);
    rewind(stream);
    if (fread(text, 1, (size_t)size, stream) != (size_t)size) stop("cannot be read", file);
    fclose(stream);
    return text;
}

/* The field of a line of a CSV file, counted from 0; fields in quotes may contain commas. */
static void csv_field(const char *line, int index, char *field, size_t size) {
    int quoted = 0;
    size_t length = 0;
    for (; *line && *line != '\n' && *line != '\r'; line++) {
        if (*line == '"') quoted = !quoted;
        else if (*line == ',' && !quoted) index--;
        else if (index == 0 && length + 1 < size) field[length++] = *line;
    }
    field[length] = 0;
}

/* Write a text in quotes, with the escapes of TOML. */
static void write_text(FILE *file, const char *text) {
    fputc('"', file);
    for (const unsigned char *c = (const unsigned char *)text; *c; c++) {
        if (*c == '"' || *c == '\\') fprintf(file, "\\%c", *c);
        else if (*c < 0x20 || *c == 0x7f) fprintf(file, "\\u%04x", (unsigned)*c);
        else fputc(*c, file);
    }
    fputc('"', file);
}

/* Write a line `key = value`; a key with other characters than letters, digits, _ and - must be in quotes. */
static void write_line(FILE *file, const Line *line) {
    const char *bare = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
    if (*line->key && !line->key[strspn(line->key, bare)]) fputs(line->key, file);
    else write_text(file, line->key);
    fputs(" = ", file);
    if (line->text) write_text(file, line->text);
    else fprintf(file, "%.15g", line->number);
    fputc('\n', file);
}

int main(int count, char **arguments) {
    enum { LONGEST = 4096, MOST_COLUMNS = 64, MOST_SCENES = 64 };
    char file[LONGEST], name[256], text[256];
    Line declined[MOST_SCENES];
    size_t declined_count = 0;
    if (count != 3) stop("usage", "runner BENCHMARK SUBMISSION");

    snprintf(file, sizeof file, "%s/scenes.csv", arguments[1]);
    const char *line = read_file(file);
    int column_of_step = 0;
    do csv_field(line, column_of_step++, text, sizeof text);
    while (strcmp(text, "max_step") != 0 && column_of_step < MOST_COLUMNS);
    column_of_step--;

    while ((line = strchr(line, '\n')) && *++line) {
        csv_field(line, 0, name, sizeof name);
        csv_field(line, column_of_step, text, sizeof text);
        snprintf(file, sizeof file, "%s/scenes/%s/scene.json", arguments[1], name);
        const char *json = read_file(file);
        const Json *scene = json_get(parse(&json), "scene");

        snprintf(file, sizeof file, "%s/%s.csv", arguments[2], name);
        FILE *table = fopen(file, "w");
        if (!table) stop("cannot be written; does the folder exist?", file);
        const char *reason = simulate(name, scene, strtod(text, 0), table);
        fclose(table);
        printf("%s: %s\n", name, reason ? reason : "solved");
        if (reason) {
            remove(file);
            if (declined_count == MOST_SCENES) stop("more scenes than expected", arguments[1]);
            char *scene_name = malloc(strlen(name) + 1);
            declined[declined_count++] = (Line){strcpy(scene_name, name), reason, 0};
        }
    }

    snprintf(file, sizeof file, "%s/submission.toml", arguments[2]);
    FILE *description = fopen(file, "w");
    if (!description) stop("cannot be written", file);
    for (size_t i = 0; i < sizeof about / sizeof *about; i++) write_line(description, &about[i]);
    fputs("\n[settings]\n", description);
    for (size_t i = 0; i < sizeof settings / sizeof *settings; i++) write_line(description, &settings[i]);
    fputs("\n[declined]\n", description);
    for (size_t i = 0; i < declined_count; i++) write_line(description, &declined[i]);
    return fclose(description) ? 1 : 0;
}
