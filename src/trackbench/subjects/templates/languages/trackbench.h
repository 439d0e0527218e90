/* A tracker in C for trackbench, protocol version 1. It needs nothing but the C library, C99, of a POSIX system.

   Write the five functions below. Compiled with -DTRACKBENCH_PROGRAM the file is a program (use: {command: [./mine]}).
   Units are SI and radians; of arrays of several axes the last one runs fastest. */
#ifndef TRACKBENCH_H
#define TRACKBENCH_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

#define TB_ABI 1
#define TB_EXPORT __attribute__((visibility("default")))

typedef struct {
    double time, arrival_time;       /* s */
    const char *sensor, *kind;       /* its name in the scenario; "radar", "lidar", ... */
    int64_t components;              /* m of a measurement */
    int64_t detections;              /* D with hidden identities, 1 with known ones */
    int64_t batch;                   /* n members; 1 unless the tracker takes batches */
    const double *measurement;       /* (m, D, n), NaN where not valid */
    const double *valid;             /* (D, n): 1 or 0 */
    const double *noise_covariance;  /* (m, m) */
    const double *sensor_pose;       /* x, y, yaw in the fixed frame */
    const double *sensor_velocity;   /* vx, vy in the fixed frame */
    double detection_probability;    /* NaN with known identities, as the next */
    double clutter_density;
    const double *field_of_view;     /* half angle, range, volume (NaN without end); NULL with known identities */
    int64_t asked, place;
} tb_scan;

typedef struct {
    double *mean, *covariance;       /* (4, n) and (4, 4, n), room for which is there: px, py, vx, vy */
    /* Of several objects: set these, and the two above, to memory of your own, which stays until the next call. */
    int64_t tracks;                  /* K, the largest number of any member */
    const double *ids;               /* (K, n), -1 where a member has fewer */
    const double *existence, *used;  /* (K, n), or NULL */
    const char *error;               /* set it and return TB_FAILED */
} tb_answer;

typedef struct {
    int64_t abi;                     /* TB_ABI */
    const char *name;
    int64_t batched, is_random, copies; /* whether it takes batches, draws random numbers, and has tb_copy */
} tb_traits;

enum { TB_NONE = 0, TB_ESTIMATE = 1, TB_TRACKS = 2, TB_FAILED = -1 };

/* To be written. tb_create returns NULL where the tracker cannot start; `hidden`: whether it is of several objects.
   tb_copy is needed where the traits say `copies`; elsewhere it may return NULL. */
TB_EXPORT void tb_describe(tb_traits *traits);
TB_EXPORT void *tb_create(const char *options_json, int64_t hidden);
TB_EXPORT int64_t tb_step(void *tracker, const tb_scan *scan, tb_answer *answer);
TB_EXPORT void *tb_copy(const void *tracker);
TB_EXPORT void tb_destroy(void *tracker);

/* Where the value of a key at the top of a JSON object begins; NULL where it is not there. */
static inline const char *tb_option(const char *json, const char *key) {
    size_t depth = 0, length = strlen(key);
    for (const char *at = json; *at; at++) {
        if (*at == '"') {
            const char *start = ++at;
            while (*at && *at != '"') at += *at == '\\' && at[1] ? 2 : 1;
            if (!*at) return NULL;
            const char *next = at + 1 + strspn(at + 1, " ");
            if (depth == 1 && *next == ':' && (size_t)(at - start) == length && !memcmp(start, key, length))
                return next + 1 + strspn(next + 1, " ");
        } else if (*at == '{' || *at == '[') {
            depth++;
        } else if (*at == '}' || *at == ']') {
            depth--;
        }
    }
    return NULL;
}

static inline double tb_number(const char *json, const char *key, double otherwise) {
    const char *value = tb_option(json, key);
    if (!value || !strchr("-0123456789", *value)) return otherwise;
    return strtod(value, NULL);
}

#ifdef TRACKBENCH_PROGRAM
int tb_main(int argc, char **argv);
#ifndef __cplusplus
int main(int argc, char **argv) { return tb_main(argc, argv); }
#endif
#include "trackbench_program.h"
#endif

#ifdef __cplusplus
}
#endif
#endif
