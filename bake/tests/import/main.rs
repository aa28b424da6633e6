//! Tests of the importers: what they read, what they refuse, and that nothing makes them panic.

mod fuzz;
mod gltf;
mod malformed;
mod models;
mod obj;
mod packed;
mod sample;
