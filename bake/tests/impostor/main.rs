//! Impostors: views, groups, and what a build makes of pictures that a small renderer of the tests' own takes.

mod build;
mod capture;
#[path = "../common/mod.rs"]
mod common;
mod compose;
mod file;
mod gaps;
mod groups;
mod silhouettes;
mod views;
