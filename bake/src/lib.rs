//! Bakes rigged characters for Throng: a character file becomes continuous levels of detail, a palette texture, animated
//! bounds and a `.throng` file. Pure CPU; it owns the file format.
//!
//! Data flows one way: [`import`] -> [`character::Character`] -> [`merge`] -> [`mesh::Mesh`] -> [`simplify`] ->
//! [`mesh::CollapseSequence`] -> [`sliding_tris`] -> [`baked::Baked`] -> [`mod@file`].

#![forbid(unsafe_code)]

pub mod bake;
pub mod baked;
pub mod bc7;
pub mod body_parts;
pub mod character;
pub mod error;
pub mod export;
pub mod file;
pub mod glb;
mod ground_speed;
pub mod import;
pub mod impostor;
pub mod indices;
pub mod merge;
pub mod mesh;
pub mod palette;
pub mod people;
pub mod pose;
pub mod quantize;
pub mod simplify;
pub mod sliding_tris;
pub mod texture;
pub mod tint;
pub mod validate;
pub mod words;
