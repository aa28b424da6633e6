//! The CPU twins of the GPU stages: same inputs, same outputs, plain loops.

pub mod capture;
pub mod impostor;
pub mod mesh;
pub mod occlude;
pub mod select;
