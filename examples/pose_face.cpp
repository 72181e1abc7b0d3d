// Pose a face with the C files that `make deploy` wrote, here the teen's:
// cc -std=c99 -O3 -c deploy_teen.c && c++ pose_face.cpp deploy_teen.o && ./a.out jaw_open 0.6 > vertices.txt
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "deploy_teen.h"

int main(int count, char **words)
{
    std::vector<float> parameters, vertices(3 * TEEN_VERTICES);
    for (const teen_control &control : teen_controls)
        parameters.push_back(control.at_rest);
    for (int k = 1; k + 1 < count; k += 2)
        for (int i = 0; i < TEEN_CONTROLS; i++)
            if (!std::strcmp(words[k], teen_controls[i].name))
                parameters[i] = std::strtof(words[k + 1], nullptr);
    teen_pose(parameters.data(), vertices.data()); // mm
    for (int i = 0; i < TEEN_VERTICES; i++)
        std::printf("%.4f %.4f %.4f\n", vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]);
}
