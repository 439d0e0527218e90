/* The framing of a program that trackbench starts: uint32 little-endian length, then a MessagePack map. */
#ifndef TRACKBENCH_PROGRAM_H
#define TRACKBENCH_PROGRAM_H

#include <unistd.h>

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "arrays are sent as they are in memory: this is for little-endian machines"
#endif

#define TB_VERSION 1
#define TB_LARGEST (1u << 27)

typedef struct {
    unsigned char *bytes;
    size_t size, room;
} tb_buffer;

static void tb_reserve(tb_buffer *buffer, size_t more) {
    if (buffer->size + more <= buffer->room) return;
    buffer->room = 2 * (buffer->size + more) + 4096;
    buffer->bytes = (unsigned char *)realloc(buffer->bytes, buffer->room);
    if (!buffer->bytes) {
        fprintf(stderr, "trackbench.h: out of memory\n");
        exit(70);
    }
}

static void tb_put(tb_buffer *to, const void *bytes, size_t size) {
    tb_reserve(to, size);
    if (size) memcpy(to->bytes + to->size, bytes, size);
    to->size += size;
}

/* -- Writing ------------------------------------------------------------------------------------------------------ */

static void tb_put_head(tb_buffer *to, unsigned char code, uint64_t value, int bytes) {
    unsigned char head[9] = {code};
    for (int i = 0; i < bytes; i++) head[1 + i] = (unsigned char)(value >> (8 * (bytes - 1 - i)));
    tb_put(to, head, 1 + (size_t)bytes);
}

static void tb_put_text(tb_buffer *to, const char *text) {
    size_t size = strlen(text) < 65535 ? strlen(text) : 65535;
    if (size < 32) tb_put_head(to, (unsigned char)(0xa0 | size), 0, 0);
    else tb_put_head(to, 0xda, size, 2);
    tb_put(to, text, size);
}

static void tb_put_flag(tb_buffer *to, const char *key, int64_t value) {
    tb_put_text(to, key);
    tb_put_head(to, value ? 0xc3 : 0xc2, 0, 0);
}

/* An array without the axes of which the shape has -1. */
static void tb_put_array(tb_buffer *to, const char *key, const double *values, const int64_t shape[4]) {
    unsigned char axes = 0;
    uint64_t count = 1;
    for (int i = 0; i < 4; i++) axes = (unsigned char)(axes + (shape[i] >= 0));
    tb_put_text(to, key);
    tb_put_head(to, 0x92, 0, 0);
    tb_put_head(to, (unsigned char)(0x90 | axes), 0, 0);
    for (int i = 0; i < 4; i++) {
        if (shape[i] < 0) continue;
        tb_put_head(to, 0xce, (uint64_t)shape[i], 4);
        count *= (uint64_t)shape[i];
    }
    tb_put_head(to, 0xc6, 8 * count, 4);
    tb_put(to, values, 8 * count);
}

static int tb_send(tb_buffer *frame, int descriptor) {
    uint32_t size = (uint32_t)(frame->size - 4);
    memcpy(frame->bytes, &size, 4);
    for (size_t done = 0; done < frame->size;) {
        ssize_t written = write(descriptor, frame->bytes + done, frame->size - done);
        if (written <= 0) return 0;
        done += (size_t)written;
    }
    return 1;
}

static void tb_begin(tb_buffer *frame, const char *type, unsigned char keys) {
    frame->size = 0;
    tb_put(frame, "\0\0\0\0", 4);
    tb_put_head(frame, (unsigned char)(0x80 | keys), 0, 0);
    tb_put_text(frame, "type");
    tb_put_text(frame, type);
}

/* -- Reading ------------------------------------------------------------------------------------------------------ */

typedef struct {
    const unsigned char *at, *end;
    int bad;
} tb_input;

typedef struct {
    char kind; /* n nil, b boolean, i integer, d double, s text, x bytes, a array, m map */
    uint64_t count;
    double number;
    const unsigned char *bytes;
} tb_item;

static uint64_t tb_get(tb_input *from, size_t bytes) {
    uint64_t value = 0;
    if ((size_t)(from->end - from->at) < bytes) {
        from->bad = 1;
        return 0;
    }
    while (bytes--) value = value << 8 | *from->at++;
    return value;
}

/* The next item; of an array or a map its head alone. */
static tb_item tb_next(tb_input *from) {
    tb_item item = {'n', 0, 0.0, NULL};
    unsigned code = (unsigned)tb_get(from, 1);
    if (code < 0x80 || code >= 0xe0) {
        item.kind = 'i';
        item.number = code < 0x80 ? (double)code : (double)(int)code - 256;
    } else if (code < 0x90 || code == 0xde || code == 0xdf) {
        item.kind = 'm';
        item.count = code < 0x90 ? code & 15 : tb_get(from, code == 0xde ? 2 : 4);
    } else if (code < 0xa0 || code == 0xdc || code == 0xdd) {
        item.kind = 'a';
        item.count = code < 0xa0 ? code & 15 : tb_get(from, code == 0xdc ? 2 : 4);
    } else if (code < 0xc0 || (code >= 0xd9 && code <= 0xdb)) {
        item.kind = 's';
        item.count = code < 0xc0 ? code & 31 : tb_get(from, (size_t)1 << (code - 0xd9));
    } else if (code == 0xc2 || code == 0xc3) {
        item.kind = 'b';
        item.number = code == 0xc3;
    } else if (code >= 0xc4 && code <= 0xc6) {
        item.kind = 'x';
        item.count = tb_get(from, (size_t)1 << (code - 0xc4));
    } else if (code == 0xca) {
        uint32_t bits = (uint32_t)tb_get(from, 4);
        float value;
        memcpy(&value, &bits, 4);
        item.kind = 'd';
        item.number = value;
    } else if (code == 0xcb) {
        uint64_t bits = tb_get(from, 8);
        item.kind = 'd';
        memcpy(&item.number, &bits, 8);
    } else if (code >= 0xcc && code <= 0xcf) {
        item.kind = 'i';
        item.number = (double)tb_get(from, (size_t)1 << (code - 0xcc));
    } else if (code >= 0xd0 && code <= 0xd3) {
        size_t bytes = (size_t)1 << (code - 0xd0);
        uint64_t bits = tb_get(from, bytes), sign = 1ull << (8 * bytes - 1);
        item.kind = 'i';
        item.number = (double)(int64_t)((bits ^ sign) - sign);
    } else if (code != 0xc0) {
        from->bad = 1;
    }
    if (item.kind == 's' || item.kind == 'x') {
        item.bytes = from->at;
        if ((uint64_t)(from->end - from->at) < item.count) from->bad = 1;
        else from->at += item.count;
    }
    return item;
}

static int tb_is(tb_item item, const char *text) {
    return item.kind == 's' && item.count == strlen(text) && !memcmp(item.bytes, text, item.count);
}

static void tb_skip(tb_input *from, int depth) {
    tb_item item = tb_next(from);
    uint64_t parts = item.kind == 'm' ? 2 * item.count : item.kind == 'a' ? item.count : 0;
    if (depth > 64) from->bad = 1;
    while (parts-- && !from->bad) tb_skip(from, depth + 1);
}

/* The next item as JSON. */
static void tb_json(tb_input *from, tb_buffer *to, int depth) {
    char number[40];
    tb_item item = tb_next(from);
    if (depth > 64) from->bad = 1;
    if (item.kind == 'm' || item.kind == 'a') {
        tb_put(to, item.kind == 'm' ? "{" : "[", 1);
        for (uint64_t i = 0; i < item.count && !from->bad; i++) {
            if (i) tb_put(to, ",", 1);
            tb_json(from, to, depth + 1);
            if (item.kind == 'm') tb_put(to, ":", 1), tb_json(from, to, depth + 1);
        }
        tb_put(to, item.kind == 'm' ? "}" : "]", 1);
    } else if (item.kind == 's') {
        tb_put(to, "\"", 1);
        for (uint64_t i = 0; i < item.count; i++) {
            unsigned char letter = item.bytes[i];
            snprintf(number, sizeof number, letter == '"' || letter == '\\' ? "\\%c" : letter < 32 ? "\\u%04x" : "%c", letter);
            tb_put(to, number, strlen(number));
        }
        tb_put(to, "\"", 1);
    } else {
        if (item.kind == 'b') snprintf(number, sizeof number, item.number != 0.0 ? "true" : "false");
        else if (item.kind == 'i' || item.kind == 'd') snprintf(number, sizeof number, "%.17g", item.number);
        else snprintf(number, sizeof number, "null");
        tb_put(to, number, strlen(number));
    }
}

/* -- The loop ----------------------------------------------------------------------------------------------------- */

typedef struct {
    int64_t count, shape[4];
    const double *values;
} tb_array;

/* Room of one frame for arrays, which are aligned, and texts that end with 0. */
static void *tb_room(tb_buffer *pool, size_t size) {
    pool->size = (pool->size + 7) & ~(size_t)7;
    void *place = pool->bytes + pool->size;
    pool->size += size;
    return place;
}

static const char *tb_text(tb_input *from, tb_buffer *pool) {
    tb_item item = tb_next(from);
    if (item.kind != 's') from->bad = 1;
    if (from->bad) return "";
    char *text = (char *)tb_room(pool, item.count + 1);
    memcpy(text, item.bytes, item.count);
    text[item.count] = 0;
    return text;
}

/* A whole number, of which none that is large is sent. */
static uint32_t tb_whole(tb_input *from) {
    double number = tb_next(from).number;
    if (number >= 0.0 && number < TB_LARGEST) return (uint32_t)number;
    from->bad = 1;
    return 0;
}

static tb_array tb_read_array(tb_input *from, tb_buffer *pool) {
    tb_array array = {0, {1, 1, 1, 1}, NULL};
    tb_item item = tb_next(from);
    if (item.kind == 'n') return array;
    tb_item shape = tb_next(from);
    if (item.kind != 'a' || shape.kind != 'a' || shape.count > 4) from->bad = 1;
    array.count = 1;
    for (uint64_t i = 0; i < shape.count && !from->bad; i++) {
        array.shape[i] = tb_whole(from);
        array.count *= array.shape[i];
        if (array.count > TB_LARGEST) from->bad = 1;
    }
    tb_item content = tb_next(from);
    if (content.kind != 'x' || content.count != 8 * (uint64_t)array.count) from->bad = 1;
    if (from->bad) return array;
    double *values = (double *)tb_room(pool, content.count);
    memcpy(values, content.bytes, content.count);
    array.values = values;
    return array;
}

typedef struct {
    int out, hidden;
    tb_traits traits;
    tb_buffer options, frame, pool, estimate;
    void **trackers; /* by id */
    size_t room;
} tb_loop;

static void *tb_tracker(tb_loop *loop, size_t id) {
    return id < loop->room ? loop->trackers[id] : NULL;
}

static void tb_keep(tb_loop *loop, size_t id, void *tracker) {
    if (id >= loop->room) {
        size_t room = 2 * id + 64;
        loop->trackers = (void **)realloc(loop->trackers, room * sizeof(void *));
        if (!loop->trackers) exit(70);
        memset(loop->trackers + loop->room, 0, (room - loop->room) * sizeof(void *));
        loop->room = room;
    }
    loop->trackers[id] = tracker;
}

static int tb_say_error(tb_loop *loop, uint32_t id, const char *error) {
    tb_begin(&loop->frame, "error", 3);
    tb_put_text(&loop->frame, "id");
    tb_put_head(&loop->frame, 0xce, id, 4);
    tb_put_text(&loop->frame, "message");
    tb_put_text(&loop->frame, error);
    return tb_send(&loop->frame, loop->out);
}

/* `n`: members, -1 of a tracker that takes no batches. */
static int tb_say_answer(tb_loop *loop, int64_t kind, uint32_t id, const tb_answer *answer, int64_t n) {
    tb_buffer *frame = &loop->frame;
    int several = kind == TB_TRACKS;
    unsigned char more = several ? (unsigned char)(3 + !!answer->existence + !!answer->used) : 2;
    tb_begin(frame, kind == TB_NONE ? "none" : several ? "tracks" : "estimate", kind == TB_NONE ? 2 : (unsigned char)(2 + more));
    tb_put_text(frame, "id");
    tb_put_head(frame, 0xce, id, 4);
    if (kind != TB_NONE) {
        int64_t k = several ? answer->tracks : -1;
        const int64_t mean[4] = {4, k, n, -1}, covariance[4] = {4, 4, k, n}, ids[4] = {k, n, -1, -1};
        tb_put_array(frame, "mean", answer->mean, mean);
        tb_put_array(frame, "covariance", answer->covariance, covariance);
        if (several) tb_put_array(frame, "ids", answer->ids, ids);
        if (several && answer->existence) tb_put_array(frame, "existence", answer->existence, ids);
        if (several && answer->used) tb_put_array(frame, "used", answer->used, ids);
    }
    return tb_send(frame, loop->out);
}

static int tb_on_scan(tb_loop *loop, uint32_t id, tb_scan *scan, const tb_array arrays[5]) {
    tb_array measurement = arrays[0];
    int64_t axis = 1;
    for (int i = 0; i < 5; i++)
        if (!arrays[i].values) return 0;
    scan->components = measurement.shape[0];
    if (arrays[1].count * scan->components != measurement.count) return 0;
    if (arrays[2].count != scan->components * scan->components || arrays[3].count != 3 || arrays[4].count != 2) return 0;
    scan->measurement = measurement.values;
    scan->valid = arrays[1].values;
    scan->noise_covariance = arrays[2].values;
    scan->sensor_pose = arrays[3].values;
    scan->sensor_velocity = arrays[4].values;
    scan->detections = loop->hidden ? measurement.shape[axis++] : 1;
    scan->batch = loop->traits.batched ? measurement.shape[axis] : 1;
    void *tracker = tb_tracker(loop, id);
    if (!tracker) return tb_say_error(loop, id, "the tracker could not be created");
    loop->estimate.size = 0;
    tb_reserve(&loop->estimate, 20 * sizeof(double) * (size_t)scan->batch);
    tb_answer answer;
    memset(&answer, 0, sizeof answer);
    answer.mean = (double *)(void *)loop->estimate.bytes;
    answer.covariance = answer.mean + 4 * scan->batch;
    int64_t kind = tb_step(tracker, scan, &answer);
    if (kind == TB_FAILED) return tb_say_error(loop, id, answer.error ? answer.error : "it failed");
    return tb_say_answer(loop, kind, id, &answer, loop->traits.batched ? scan->batch : -1);
}

/* The arguments --key value of the command as options that the scenario does not state. */
static void tb_add_arguments(tb_buffer *options, int argc, char **argv) {
    options->size--;
    for (int i = 1; i + 1 < argc; i++) {
        char *end, *key = argv[i], *value = argv[i + 1];
        if (strncmp(key, "--", 2) || strpbrk(value, "\"\\") || strpbrk(key, "\"\\")) continue;
        strtod(value, &end);
        const char *quote = *end || end == value ? "\"" : "";
        const char *parts[] = {options->bytes[options->size - 1] == '{' ? "\"" : ",\"", key + 2, "\":", quote, value, quote};
        for (size_t part = 0; part < 6; part++) tb_put(options, parts[part], strlen(parts[part]));
    }
    tb_put(options, "}", 2);
    options->size--;
}

static int tb_on_message(tb_loop *loop, tb_input *from, int argc, char **argv) {
    tb_buffer *pool = &loop->pool;
    tb_scan scan;
    tb_array arrays[5], view = {0, {1, 1, 1, 1}, NULL};
    static const char *const names[] = {"measurement", "valid", "noise_covariance", "sensor_pose", "sensor_velocity"};
    tb_item head = tb_next(from), type = {'n', 0, 0.0, NULL};
    uint32_t id = 0, of = 0;
    memset(&scan, 0, sizeof scan);
    memset(arrays, 0, sizeof arrays);
    scan.detection_probability = scan.clutter_density = NAN;
    if (head.kind != 'm') return 0;
    for (uint64_t i = 0; i < head.count && !from->bad; i++) {
        tb_item key = tb_next(from);
        if (tb_is(key, "type")) type = tb_next(from);
        else if (tb_is(key, "id")) id = tb_whole(from);
        else if (tb_is(key, "of")) of = tb_whole(from);
        else if (tb_is(key, "field_of_view")) view = tb_read_array(from, pool);
        else if (tb_is(key, "sensor")) scan.sensor = tb_text(from, pool);
        else if (tb_is(key, "kind")) scan.kind = tb_text(from, pool);
        else if (tb_is(key, "time")) scan.time = tb_next(from).number;
        else if (tb_is(key, "arrival_time")) scan.arrival_time = tb_next(from).number;
        else if (tb_is(key, "detection_probability")) scan.detection_probability = tb_next(from).number;
        else if (tb_is(key, "clutter_density")) scan.clutter_density = tb_next(from).number;
        else if (tb_is(key, "asked")) scan.asked = tb_next(from).number != 0.0;
        else if (tb_is(key, "place")) scan.place = tb_whole(from);
        else if (tb_is(key, "identities")) loop->hidden = tb_is(tb_next(from), "hidden");
        else if (tb_is(key, "options")) loop->options.size = 0, tb_json(from, &loop->options, 0);
        else {
            size_t place = 0;
            while (place < 5 && !tb_is(key, names[place])) place++;
            if (place < 5) arrays[place] = tb_read_array(from, pool);
            else tb_skip(from, 0);
        }
    }
    if (from->bad) return 0;
    if (view.count == 3) scan.field_of_view = view.values;
    if (tb_is(type, "scan")) return scan.sensor && scan.kind ? tb_on_scan(loop, id, &scan, arrays) : 0;
    if (tb_is(type, "start") && loop->options.size) tb_keep(loop, id, tb_create((const char *)loop->options.bytes, loop->hidden));
    if (tb_is(type, "copy") && tb_tracker(loop, of)) tb_keep(loop, id, tb_copy(tb_tracker(loop, of)));
    if (tb_is(type, "end") && tb_tracker(loop, id)) {
        tb_destroy(tb_tracker(loop, id));
        loop->trackers[id] = NULL;
    }
    if (!tb_is(type, "hello")) return 1;
    if (!loop->options.size || loop->options.bytes[0] != '{') return 0;
    tb_add_arguments(&loop->options, argc, argv);
    tb_begin(&loop->frame, "hello", 6);
    tb_put_text(&loop->frame, "version");
    tb_put_head(&loop->frame, TB_VERSION, 0, 0);
    tb_put_text(&loop->frame, "name");
    tb_put_text(&loop->frame, loop->traits.name ? loop->traits.name : "");
    tb_put_flag(&loop->frame, "batched", loop->traits.batched);
    tb_put_flag(&loop->frame, "random", loop->traits.is_random);
    tb_put_flag(&loop->frame, "copies", loop->traits.copies);
    return tb_send(&loop->frame, loop->out);
}

/* Serve the bench until it ends. What the tracker prints on standard output goes to standard error from now on. */
int tb_main(int argc, char **argv) {
    tb_loop loop;
    tb_buffer input = {NULL, 0, 0};
    memset(&loop, 0, sizeof loop);
    fflush(stdout);
    loop.out = dup(1);
    dup2(2, 1);
    tb_describe(&loop.traits);
    for (;;) {
        uint32_t size = 0;
        size_t needed = 4, done = 0;
        while (input.size >= 4) {
            memcpy(&size, input.bytes + done, 4);
            if (size > TB_LARGEST) break;
            needed = 4 + (size_t)size;
            if (input.size - done < needed) break;
            loop.pool.size = 0;
            tb_reserve(&loop.pool, 2 * (size_t)size + 1024);
            tb_input frame = {input.bytes + done + 4, input.bytes + done + needed, 0};
            if (!tb_on_message(&loop, &frame, argc, argv)) {
                fprintf(stderr, "trackbench.h: a message that cannot be read, or no bench to answer\n");
                return 2;
            }
            done += needed;
            needed = 4;
            if (input.size - done < 4) break;
        }
        if (size > TB_LARGEST) return 2;
        if (done) memmove(input.bytes, input.bytes + done, input.size - done);
        input.size -= done;
        tb_reserve(&input, needed > 65536 ? needed : 65536);
        ssize_t got = read(0, input.bytes + input.size, input.room - input.size);
        if (got <= 0) return 0;
        input.size += (size_t)got;
    }
}

#endif
