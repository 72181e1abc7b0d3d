/** @file
   $about

   $header and its .c need C99 and libm alone. Nothing is allocated and no state is kept: threads may pose
   at once. A call needs about ${stack_kb} kB of stack.

   Parameters are raw rig parameters without a unit, in the order of `${name}_controls`. What lies outside a control's
   limits is not clamped: the face is evaluated there as it is, as in Python. Training saw such poses (Eq. 5). Beyond
   what it saw, the networks' layers stay where they are, and their straight lines go on.

   Vertices are in millimetres, x to the character's left, y up, z forward, x y z of one vertex after the other, in the
   order of the mesh in $mesh.

   $licence */

#ifndef $guard
#define $guard

#ifdef __cplusplus
extern "C" {
#endif

#define ${upper}_CONTROLS $controls
#define ${upper}_VERTICES $vertices
#define ${upper}_SEGMENTS $segments

/** A control of the rig: its name, the part of the face that it moves, its limits and its value at rest. */
typedef struct {
    const char *name;
    const char *region;
    float lower, at_rest, upper;
} ${name}_control;

/** All controls, in the order of the parameters. */
extern const ${name}_control ${name}_controls[${upper}_CONTROLS];

/** Names of the mesh's segments. */
extern const char *const ${name}_segments[${upper}_SEGMENTS];

/** Where a control stands among the parameters. */
enum {
$enum
};

/** Write the vertices of one pose, in mm.
    @param parameters ${upper}_CONTROLS numbers
    @param[out] vertices 3 * ${upper}_VERTICES numbers, x y z of one vertex after the other */
void ${name}_pose(const float *parameters, float *vertices);

#ifdef __cplusplus
}
#endif

#endif
