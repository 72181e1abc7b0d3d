// Pose a face with the C files that `make deploy` wrote, here the teen's:
// cc -std=c99 -O3 -c deploy_teen.c && rustc pose_face.rs -C link-arg=deploy_teen.o -C link-arg=-lm
// ./pose_face jaw_open 0.6 > vertices.txt
use std::ffi::{c_char, CStr};

const CONTROLS: usize = 258; // TEEN_CONTROLS and TEEN_VERTICES of the header
const VERTICES: usize = 12510;

#[repr(C)]
struct Control { name: *const c_char, region: *const c_char, lower: f32, at_rest: f32, upper: f32 }

extern "C" {
    static teen_controls: [Control; CONTROLS];
    fn teen_pose(parameters: *const f32, vertices: *mut f32);
}

fn main() {
    let controls = unsafe { &teen_controls };
    let mut parameters: Vec<f32> = controls.iter().map(|control| control.at_rest).collect();
    let words: Vec<String> = std::env::args().skip(1).collect();
    for pair in words.chunks_exact(2) {
        let named = |c: &Control| unsafe { CStr::from_ptr(c.name) }.to_str() == Ok(pair[0].as_str());
        let place = controls.iter().position(named).expect("no such control");
        parameters[place] = pair[1].parse().expect("expected a number");
    }
    let mut vertices = vec![0f32; 3 * VERTICES];
    unsafe { teen_pose(parameters.as_ptr(), vertices.as_mut_ptr()) }; // mm
    for v in vertices.chunks_exact(3) {
        println!("{:.4} {:.4} {:.4}", v[0], v[1], v[2]);
    }
}
