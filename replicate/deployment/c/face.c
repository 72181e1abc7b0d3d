/* $about
   $header says how it is used. Below are its arithmetic, which is the same for all faces, and its numbers.

   $licence */

#include "$header"

#include <math.h>
#include <stdint.h>

/* Shapes are stored in 8 bits, the first of each region in 16; weights are floats of 16 bits. They stand in strings,
   which compilers read far faster than lists of numbers. Each row ends with a zero that nobody reads. */
typedef unsigned char byte;

enum {
    LETTER = $letter, /* what is added to 8 bits, so that most of them are letters */
    AT_ONCE = 4,      /* rows that are added at once */
    GATED = $gated,
    NETWORKS = $networks,
    LAYERS = $layers,
    COEFFICIENTS = $coefficients,
    REGIONS = $regions,
    RIGID = $rigid
};

static const float SLOPE = $slope;

/* y = bias + unit * x @ weights; weights are [inputs][outputs]. */
typedef struct {
    int inputs, outputs;
    float unit;
    const float *bias;
    const byte *high, *low;
} layer;

/* A network of some of the controls: hidden layers, and after them last + line. The line sees the controls as they are,
   the layers what training saw of them at most. least, most: what hidden layers give at most, one after the other. */
typedef struct {
    int inputs;
    const uint32_t *controls;
    const float *lowest, *highest, *least, *most;
    const layer *hidden;
    layer last, line;
} network;

/* Vertices that move together, by weight * sum over shapes of step * coefficient * shape, mm. Regions overlap. */
typedef struct {
    int vertices, fine, rough;
    const uint32_t *members;
    const float *weights;
    const byte *high, *low, *eight;
} moving_region;

/* Vertices that follow their carriers. rest: the carriers about their mean, arms: the vertices seen from it, mm. */
typedef struct {
    int carrier_count, member_count;
    const uint32_t *carriers, *members;
    const float *rest, *arms;
} rigid_segment;

/* A 16-bit float over 2^112, which no weight is too small for. */
static inline float half(byte high, byte low)
{
    union {
        uint32_t bits;
        float value;
    } number;
    const uint32_t word = (uint32_t)high << 8 | low;
    number.bits = (word & 0x8000u) << 16 | (word & 0x7fffu) << 13;
    return number.value;
}

/* Add to y the product of x with a layer's weights. Inputs that are zero cost nothing. */
static void add_product(const float *restrict x, const layer *own, float *restrict y)
{
    float share[AT_ONCE];
    long row[AT_ONCE];
    int count = 0;
    const byte *high = own->high, *low = own->low;
    const int outputs = own->outputs;
    for (int i = 0; i < own->inputs; i++) {
        if (x[i] != 0.0f) {
            share[count] = x[i] * own->unit;
            row[count++] = (long)i * (outputs + 1);
        }
        if (count == AT_ONCE || (i == own->inputs - 1 && count > 0)) {
            for (; count < AT_ONCE; count++) {
                share[count] = 0.0f;
                row[count] = row[0];
            }
            const byte *restrict h0 = high + row[0], *restrict h1 = high + row[1], *restrict h2 = high + row[2],
                       *restrict h3 = high + row[3], *restrict l0 = low + row[0], *restrict l1 = low + row[1],
                       *restrict l2 = low + row[2], *restrict l3 = low + row[3];
            for (int k = 0; k < outputs; k++)
                y[k] += share[0] * half(h0[k], l0[k]) + share[1] * half(h1[k], l1[k]) +
                        share[2] * half(h2[k], l2[k]) + share[3] * half(h3[k], l3[k]);
            count = 0;
        }
    }
}

/* A value within two others; one that is no number stays what it is. */
static float within(float value, float least, float most)
{
    return value < least ? least : value > most ? most : value;
}

static void copy(const float *from, int count, float *to)
{
    for (int k = 0; k < count; k++)
        to[k] = from[k];
}

/* Write what follows a layer: products of its halves, gate(first) * second, or its leaky rectification. */
static void activate(const float *restrict sums, int count, float *restrict out)
{
    for (int k = 0; k < count; k++) {
        const float x = sums[k];
        out[k] = GATED ? x / (1.0f + expf(-x)) * sums[count + k] : x > 0 ? x : SLOPE * x;
    }
}

/* Add to y each of `count` shapes of 8 bits times its share. */
static void add_rough(const float *share, int count, const byte *shapes, int length, float *restrict y)
{
    for (int i = 0; i < count; i += AT_ONCE) {
        float s[AT_ONCE];
        const byte *row[AT_ONCE];
        for (int k = 0; k < AT_ONCE; k++) {
            const int own = i + k < count ? i + k : i;
            s[k] = i + k < count ? share[own] : 0.0f;
            row[k] = shapes + (long)own * (length + 1);
        }
        const byte *restrict a = row[0], *restrict b = row[1], *restrict c = row[2], *restrict d = row[3];
        for (int j = 0; j < length; j++)
            y[j] += s[0] * (signed char)(byte)(a[j] - LETTER) + s[1] * (signed char)(byte)(b[j] - LETTER) +
                    s[2] * (signed char)(byte)(c[j] - LETTER) + s[3] * (signed char)(byte)(d[j] - LETTER);
    }
}

/* Add to y each of `count` shapes of 16 bits times its share. */
static void add_fine(const float *share, int count, const byte *high, const byte *low, int length, float *restrict y)
{
    for (int i = 0; i < count; i++) {
        const byte *restrict h = high + (long)i * (length + 1), *restrict l = low + (long)i * (length + 1);
        const float s = share[i];
        for (int j = 0; j < length; j++)
            y[j] += s * (float)((signed char)h[j] * 256 + l[j]);
    }
}

/* Write the unit quaternion w, x, y, z of a symmetric matrix's largest eigenvalue: Jacobi's rotations. */
static void largest_eigenvector(double a[4][4], double q[4])
{
    double v[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    for (int sweep = 0; sweep < 16; sweep++) {
        double off = 0, all = 0;
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                all += a[i][j] * a[i][j];
                off += i == j ? 0 : a[i][j] * a[i][j];
            }
        if (off <= 1e-32 * all)
            break;
        for (int i = 0; i < 3; i++)
            for (int j = i + 1; j < 4; j++) {
                if (a[i][j] == 0)
                    continue;
                const double theta = (a[j][j] - a[i][i]) / (2 * a[i][j]);
                const double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                const double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 4; k++) {
                    const double x = a[k][i], y = a[k][j];
                    a[k][i] = c * x - s * y;
                    a[k][j] = s * x + c * y;
                }
                for (int k = 0; k < 4; k++) {
                    const double x = a[i][k], y = a[j][k], z = v[k][i], w = v[k][j];
                    a[i][k] = c * x - s * y;
                    a[j][k] = s * x + c * y;
                    v[k][i] = c * z - s * w;
                    v[k][j] = s * z + c * w;
                }
            }
    }
    int best = 0;
    for (int i = 1; i < 4; i++)
        best = a[i][i] > a[best][best] ? i : best;
    for (int k = 0; k < 4; k++)
        q[k] = v[k][best];
}

/* Place a rigid segment as its carriers are turned and shifted best (Eq. 3): Horn's quaternion. */
static void place(const rigid_segment *own, float *vertices)
{
    const int count = own->carrier_count;
    const uint32_t *carriers = own->carriers;
    const float *arms = own->arms;
    double centre[3] = {0, 0, 0}, m[3][3] = {{0}}, size = 0;
    for (int i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            centre[k] += (double)vertices[3 * (long)carriers[i] + k] / count;
    for (int i = 0; i < count; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                m[j][k] += (double)own->rest[3 * i + j] * ((double)vertices[3 * (long)carriers[i] + k] - centre[k]);
    for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++)
            size += m[j][k] * m[j][k];
    for (int k = 0; k < 3; k++) /* where carriers lie on a line, the rotation nearest to none is taken */
        m[k][k] += 1e-12 * sqrt(size) + 1e-300;
    const double trace = m[0][0] + m[1][1] + m[2][2];
    const double turn[3] = {m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]};
    double horn[4][4], q[4];
    horn[0][0] = trace;
    for (int j = 0; j < 3; j++) {
        horn[0][j + 1] = horn[j + 1][0] = turn[j];
        for (int k = 0; k < 3; k++)
            horn[j + 1][k + 1] = m[j][k] + m[k][j] - (j == k ? trace : 0);
    }
    largest_eigenvector(horn, q);
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double r[3][3] = {
        {w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)},
        {2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)},
        {2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z},
    };
    for (int i = 0; i < own->member_count; i++) {
        const double a = (double)arms[3 * i], b = (double)arms[3 * i + 1], c = (double)arms[3 * i + 2];
        float *vertex = vertices + 3 * (long)own->members[i];
        for (int k = 0; k < 3; k++)
            vertex[k] = (float)(centre[k] + a * r[0][k] + b * r[1][k] + c * r[2][k]);
    }
}

const ${name}_control ${name}_controls[${upper}_CONTROLS] = {
$control_table
};

const char *const ${name}_segments[${upper}_SEGMENTS] = {
$segment_names
};

$numbers

void ${name}_pose(const float *parameters, float *vertices)
{
    float seen[${upper}_CONTROLS], bounded[${upper}_CONTROLS];
    float sums[$widest], hidden[$widest], coefficients[COEFFICIENTS], moved[$longest];
    float *out = coefficients;
    for (const network *net = networks; net < networks + NETWORKS; net++) {
        for (int i = 0; i < net->inputs; i++)
            seen[i] = parameters[net->controls[i]] / scale[net->controls[i]];
        for (int i = 0; i < net->inputs; i++)
            bounded[i] = within(seen[i], net->lowest[i], net->highest[i]);
        const float *x = bounded, *least = net->least, *most = net->most;
        for (const layer *own = net->hidden; own < net->hidden + LAYERS; own++) {
            copy(own->bias, own->outputs, sums);
            add_product(x, own, sums);
            const int count = GATED ? own->outputs / 2 : own->outputs;
            activate(sums, count, hidden);
            for (int k = 0; k < count; k++)
                hidden[k] = within(hidden[k], *least++, *most++);
            x = hidden;
        }
        copy(net->last.bias, net->last.outputs, out);
        add_product(x, &net->last, out);
        add_product(seen, &net->line, out);
        out += net->last.outputs;
    }
    for (int i = 0; i < COEFFICIENTS; i++)
        coefficients[i] *= steps[i];
    const float *share = coefficients;
    copy(start, 3 * ${upper}_VERTICES, vertices);
    for (const moving_region *own = regions; own < regions + REGIONS; own++) {
        for (int i = 0; i < 3 * own->vertices; i++)
            moved[i] = 0.0f;
        add_fine(share, own->fine, own->high, own->low, 3 * own->vertices, moved);
        add_rough(share + own->fine, own->rough, own->eight, 3 * own->vertices, moved);
        share += own->fine + own->rough;
        for (int i = 0; i < own->vertices; i++)
            for (int k = 0; k < 3; k++)
                vertices[3 * (long)own->members[i] + k] += own->weights[i] * moved[3 * i + k];
    }
    for (const rigid_segment *own = rigid; own < rigid + RIGID; own++)
        place(own, vertices);
}

#ifdef ${upper}_DEMO /* cc -O3 -std=c99 -D${upper}_DEMO $source -lm, then ./a.out a_control=0.7 ... > vertices.txt */
#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int main(int count, char **words)
{
    static float parameters[${upper}_CONTROLS], vertices[3 * ${upper}_VERTICES];
    for (int i = 0; i < ${upper}_CONTROLS; i++)
        parameters[i] = ${name}_controls[i].at_rest;
    for (int k = 1; k < count; k++) {
        const char *end = strchr(words[k], '=');
        int i = 0;
        while (end && i < ${upper}_CONTROLS && (strncmp(words[k], ${name}_controls[i].name, (size_t)(end - words[k])) ||
                                              ${name}_controls[i].name[end - words[k]]))
            i++;
        if (!end || i == ${upper}_CONTROLS) {
            fprintf(stderr, "%s: expected control=value; the header lists the controls\n", words[k]);
            return 2;
        }
        char *after;
        parameters[i] = strtof(end + 1, &after);
        if (after == end + 1 || *after || !(fabsf(parameters[i]) <= FLT_MAX)) {
            fprintf(stderr, "%s: expected control=value with a finite number\n", words[k]);
            return 2;
        }
    }
    ${name}_pose(parameters, vertices);
    for (int i = 0; i < ${upper}_VERTICES; i++)
        for (int k = 0; k < 3; k++)
            printf("%.4f%c", (double)vertices[3 * i + k], k < 2 ? ' ' : '\n');
    return 0;
}
#endif
