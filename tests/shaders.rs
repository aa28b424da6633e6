//! The shipped SPIR-V against the host's structs and bindings, and the lint against what it is for. Needs no device.

use std::collections::BTreeSet;
use std::io::Write;
use std::process::{Command, Stdio};

use spirq::ReflectConfig;
use spirq::constant::ConstantValue;
use spirq::entry_point::EntryPoint;
use spirq::ty::{DescriptorType, MatrixAxisOrder, SpirvType, StructType, Type};
use spirq::var::Variable;
use throng::gpu::bindings::{self, Kind};
use throng::gpu::shaders::{MODULES, Module};
use throng::gpu_types::{self, LAYOUTS, Layout};

#[path = "../hlsl/lint.rs"]
mod lint;

fn reflect(module: &Module) -> EntryPoint {
    reflect_with(module, true)
}

/// With all that is declared, or with what is used.
fn reflect_with(module: &Module, all: bool) -> EntryPoint {
    let mut entries = ReflectConfig::new()
        .spv(module.spirv)
        .ref_all_rscs(all)
        .reflect()
        .unwrap_or_else(|e| panic!("{}: {e}", module.name));
    assert_eq!(entries.len(), 1, "{}", module.name);
    assert_eq!(entries[0].name, "main", "{}", module.name);
    entries.remove(0)
}

/// Structs that stand in buffers of a type, with the stride that arrays of them have.
fn structs(ty: &Type, stride: Option<usize>, found: &mut Vec<(StructType, Option<usize>)>) {
    match ty {
        Type::Array(a) => structs(&a.element_ty, a.stride, found),
        Type::Struct(s) => {
            found.push((s.clone(), stride));
            for member in &s.members {
                structs(&member.ty, None, found);
            }
        }
        _ => {}
    }
}

/// A shader type as Rust writes it; a matrix is an array of columns.
fn rust_type(ty: &Type) -> String {
    match ty {
        Type::Scalar(s) => s.to_string(),
        Type::Vector(v) => format!("[{}; {}]", v.scalar_ty, v.nscalar),
        Type::Matrix(m) => {
            // HLSL's columns are SPIR-V's rows: glslang swaps the two, so this is HLSL's default, column-major.
            assert_eq!(m.axis_order, Some(MatrixAxisOrder::RowMajor));
            assert_eq!(m.stride, m.vector_ty.nbyte(), "columns are not tight");
            format!(
                "[[{}; {}]; {}]",
                m.vector_ty.scalar_ty, m.vector_ty.nscalar, m.nvector
            )
        }
        Type::Array(a) => {
            assert_eq!(a.stride, a.element_ty.nbyte(), "elements are not tight");
            format!(
                "[{}; {}]",
                rust_type(&a.element_ty),
                a.nelement.unwrap_or(0)
            )
        }
        other => format!("{other:?}"),
    }
}

/// How a shader's struct differs from the host's.
fn difference(layout: &Layout, shader: &StructType, stride: Option<usize>) -> Option<String> {
    if layout.fields.len() != shader.members.len() {
        return Some(format!(
            "{} fields against {}",
            layout.fields.len(),
            shader.members.len()
        ));
    }
    for (field, member) in layout.fields.iter().zip(&shader.members) {
        let ours = (field.name, field.offset, field.kind.to_string());
        let theirs = (
            member.name.as_deref().unwrap_or(""),
            member.offset.unwrap_or(usize::MAX),
            rust_type(&member.ty),
        );
        if ours != theirs {
            return Some(format!("{ours:?} against {theirs:?}"));
        }
    }
    match stride {
        Some(stride) if stride != layout.size => {
            Some(format!("size {} against stride {stride}", layout.size))
        }
        _ => None,
    }
}

#[test]
fn structs_are_laid_out_alike() {
    let mut reached = BTreeSet::new();
    for module in MODULES {
        for variable in reflect(module).vars {
            let ty = match &variable {
                Variable::Descriptor { ty, .. } | Variable::PushConstant { ty, .. } => ty,
                _ => continue,
            };
            let mut found = Vec::new();
            structs(ty, None, &mut found);
            for (shader, stride) in found {
                // A constant buffer's struct has the variable's name.
                let name = match shader.name().unwrap_or("") {
                    "frame" => "FrameConstants",
                    "character" => "CharacterConstants",
                    "draw" => "DrawConstants",
                    other => other,
                };
                // glslang wraps a structured buffer's array in a struct of one member, `@data`.
                if shader.members.len() == 1 && shader.members[0].name.as_deref() == Some("@data") {
                    continue;
                }
                let layout = LAYOUTS.iter().find(|l| l.name == name).unwrap_or_else(|| {
                    panic!("{}: no twin of struct '{name}': {shader:?}", module.name)
                });
                if let Some(d) = difference(layout, &shader, stride) {
                    panic!("{}: {name}: {d}", module.name);
                }
                reached.insert(layout.name);
            }
        }
    }
    // The others are read as records of whole words, which loaders in the shaders take apart in the order of the fields.
    for layout in LAYOUTS.iter().filter(|l| !reached.contains(l.name)) {
        let fields = declared_fields(layout.name)
            .unwrap_or_else(|| panic!("no shader knows {}", layout.name));
        assert_eq!(record_difference(layout, &fields), None, "{}", layout.name);
    }
}

/// Names and Rust types of a struct's fields in hlsl/gpu_types.hlsli.
fn declared_fields(name: &str) -> Option<Vec<(String, String)>> {
    let source = include_str!("../hlsl/gpu_types.hlsli");
    let body = source.split(&format!("struct {name}\n{{")).nth(1)?;
    let body = body.split("};").next()?;
    let lines = body.lines().map(|l| l.split("//").next().unwrap_or(""));
    let fields = lines.filter_map(|l| {
        let (ty, field) = l.trim().trim_end_matches(';').split_once(' ')?;
        let scalar = ty.trim_end_matches(|c: char| c.is_ascii_digit());
        let rust = match scalar {
            "float" => "f32",
            "uint" => "u32",
            "int" => "i32",
            other => other,
        };
        let rust = match &ty[scalar.len()..] {
            "" => rust.to_string(),
            count => format!("[{rust}; {count}]"),
        };
        Some((field.to_string(), rust))
    });
    Some(fields.collect())
}

/// How a struct of records differs from the host's, whose fields follow each other without gaps.
fn record_difference(layout: &Layout, fields: &[(String, String)]) -> Option<String> {
    let mut offset = 0;
    for (i, field) in layout.fields.iter().enumerate() {
        let theirs = fields.get(i).map(|(n, t)| (n.as_str(), t.as_str()));
        if theirs != Some((field.name, field.kind)) || field.offset != offset {
            return Some(format!("{field:?} at {offset} against {theirs:?}"));
        }
        let words: usize = match field.kind.split_once("; ") {
            Some((_, count)) => count.trim_end_matches(']').parse().expect("a length"),
            None => 1,
        };
        offset += 4 * words;
    }
    let whole = fields.len() == layout.fields.len() && offset == layout.size && offset % 8 == 0;
    (!whole).then(|| format!("{} fields in {offset} bytes", fields.len()))
}

#[test]
fn a_record_that_differs_is_found() {
    let layout = LAYOUTS
        .iter()
        .find(|l| l.name == "AgentState")
        .expect("it has a twin");
    let fields = declared_fields("AgentState").expect("it is declared");
    assert_eq!(record_difference(layout, &fields), None);
    let mut swapped = fields.clone();
    swapped.swap(1, 2);
    assert!(record_difference(layout, &swapped).is_some());
    let mut retyped = fields.clone();
    retyped[3].1 = "u32".into();
    assert!(record_difference(layout, &retyped).is_some());
    assert!(record_difference(layout, &fields[1..]).is_some());
    assert!(declared_fields("NoSuchStruct").is_none());
}

#[test]
fn a_moved_field_or_another_type_or_stride_is_found() {
    let mut found = Vec::new();
    let module = MODULES.iter().find(|m| m.name == "mesh_probe");
    for variable in reflect(module.expect("it is shipped")).vars {
        if let Variable::Descriptor { ty, .. } = &variable {
            structs(ty, None, &mut found);
        }
    }
    let (shader, stride) = found
        .into_iter()
        .find(|(s, _)| s.name() == Some("Instance"))
        .expect("the probe reads instances");
    let layout = LAYOUTS
        .iter()
        .find(|l| l.name == "Instance")
        .expect("it has a twin");
    assert_eq!(difference(layout, &shader, stride), None);
    let mut moved = shader.clone();
    moved.members[1].offset = Some(16);
    assert!(difference(layout, &moved, stride).is_some());
    let mut retyped = shader.clone();
    retyped.members[1].ty = retyped.members[3].ty.clone();
    assert!(difference(layout, &retyped, stride).is_some());
    assert!(difference(layout, &shader, Some(80)).is_some());
}

#[test]
fn bindings_are_those_of_the_set_layouts() {
    for module in MODULES {
        let sets = bindings::sets_of(module.name);
        for variable in reflect(module).vars {
            let Variable::Descriptor {
                name,
                desc_bind,
                desc_ty,
                nbind,
                ..
            } = variable
            else {
                continue;
            };
            let kind = match desc_ty {
                DescriptorType::UniformBuffer() => Kind::Uniform,
                DescriptorType::StorageBuffer(_) => Kind::Storage,
                DescriptorType::SampledImage() => Kind::Image,
                DescriptorType::UniformTexelBuffer() => Kind::Texels,
                DescriptorType::Sampler() => Kind::Sampler,
                other => panic!("{}: {name:?} is a {other:?}", module.name),
            };
            let host = sets
                .get(desc_bind.set() as usize)
                .and_then(|s| s.get(desc_bind.bind() as usize));
            assert_eq!(
                host,
                Some(&kind),
                "{}: {name:?} at {desc_bind:?}",
                module.name
            );
            assert_eq!(nbind, 1, "{}: {name:?}", module.name);
        }
    }
}

/// A module that reads texel buffers has one that reads storage buffers in their place, and no other has.
#[test]
fn what_reads_texel_buffers_also_reads_storage_buffers() {
    let reads_texels = |module: &&Module| {
        let used = reflect_with(module, false).vars;
        used.iter().any(|v| {
            matches!(v, Variable::Descriptor { desc_ty, .. } if *desc_ty == DescriptorType::UniformTexelBuffer())
        })
    };
    let mut count = 0;
    for module in MODULES.iter().filter(reads_texels) {
        let name = format!("{}{}", module.name, bindings::STORAGE_SUFFIX);
        let twin = MODULES.iter().find(|m| m.name == name);
        assert!(twin.is_some_and(|m| !reads_texels(&m)), "{name}");
        count += 1;
    }
    assert!(count >= 15, "{count}");
}

/// An execution mode's operand.
fn number(value: &ConstantValue) -> u32 {
    match value {
        ConstantValue::U32(x) => *x,
        ConstantValue::Typeless(bytes) => {
            u32::from_le_bytes(bytes[..4].try_into().expect("4 bytes"))
        }
        other => panic!("{other:?} is no number"),
    }
}

#[test]
fn workgroups_have_the_sizes_that_the_host_divides_by() {
    for module in MODULES {
        let size: Vec<u32> = reflect(module)
            .exec_modes
            .iter()
            .filter(|m| m.exec_mode == spirq::spirv::ExecutionMode::LocalSize)
            .flat_map(|m| m.operands.iter().map(|o| number(&o.value)))
            .collect();
        match module.name.trim_end_matches(bindings::STORAGE_SUFFIX) {
            "select_scan" => assert_eq!(size, [gpu_types::SCAN_GROUP_SIZE, 1, 1]),
            name if name.starts_with("occlude_reduce") => {
                assert_eq!(size, [gpu_types::REDUCE_GROUP_SIZE, 1, 1])
            }
            name if name.starts_with("select")
                || name.ends_with("_probe")
                || name.ends_with("_cs") =>
            {
                assert_eq!(size, [gpu_types::SELECT_GROUP_SIZE, 1, 1])
            }
            _ => assert!(size.is_empty(), "{} is no compute shader", module.name),
        }
    }
}

#[test]
fn shared_numbers_are_equal() {
    let source = include_str!("../hlsl/gpu_types.hlsli");
    let value = |name: &str| -> f64 {
        let line = source
            .lines()
            .find(|l| l.starts_with(&format!("#define {name} ")))
            .unwrap_or_else(|| panic!("no #define {name}"));
        let text = line
            .rsplit(' ')
            .next()
            .expect("a value")
            .trim_end_matches('u');
        match text.strip_prefix("0x") {
            Some(hex) => u32::from_str_radix(hex, 16).expect("hexadecimal") as f64,
            None => text.parse().expect("a number"),
        }
    };
    use gpu_types as t;
    for (name, host) in [
        ("SELECT_GROUP_SIZE", t::SELECT_GROUP_SIZE as f64),
        ("SELECT_SHARDS", t::SELECT_SHARDS as f64),
        ("SCAN_GROUP_SIZE", t::SCAN_GROUP_SIZE as f64),
        ("SKINNING_ERROR_SHARE", t::SKINNING_ERROR_SHARE as f64),
        ("IMPOSTOR_POSE_MASK", t::IMPOSTOR_POSE_MASK as f64),
        ("IMPOSTOR_FADE_SHIFT", t::IMPOSTOR_FADE_SHIFT as f64),
        ("IMPOSTOR_FADES_OUT", t::IMPOSTOR_FADES_OUT as f64),
        ("MAX_RANGES", t::MAX_RANGES as f64),
        ("FADE_SPAN", t::FADE_SPAN as f64),
        ("FREE_STRETCH", t::FREE_STRETCH as f64),
        ("SWITCH_HEIGHT_PX", t::SWITCH_HEIGHT_PX as f64),
        ("SLICE_COUNT", t::SLICE_COUNT as f64),
        ("SLICE_SHIFT", t::SLICE_SHIFT as f64),
        ("QUAD_BIN", t::QUAD_BIN as f64),
        ("FLAT_BIN", t::FLAT_BIN as f64),
        ("IMPOSTOR_DRAWS", t::IMPOSTOR_DRAWS as f64),
        ("PACKED_COMMANDS", t::PACKED_COMMANDS as f64),
        ("PACKED_VERTICES", t::PACKED_VERTICES as f64),
        ("AGENTS_PER_INSTANCE", t::AGENTS_PER_INSTANCE as f64),
        ("IMPOSTOR_MIP_BIAS", t::IMPOSTOR_MIP_BIAS as f64),
        ("SHARPNESS_MIN", t::SHARPNESS_MIN as f64),
        ("SHARPNESS_MAX", t::SHARPNESS_MAX as f64),
        ("LEVEL_SHIFT", t::LEVEL_SHIFT as f64),
        ("BIN_NONE", t::BIN_NONE as f64),
        ("TALLY_VISIBLE", t::TALLY_VISIBLE as f64),
        ("TALLY_LIVE_VERTICES_LOW", t::TALLY_LIVE_VERTICES_LOW as f64),
        (
            "TALLY_LIVE_VERTICES_HIGH",
            t::TALLY_LIVE_VERTICES_HIGH as f64,
        ),
        ("TALLY_MESHES", t::TALLY_MESHES as f64),
        ("TALLY_OCCLUDED", t::TALLY_OCCLUDED as f64),
        ("TALLY_BINS", t::TALLY_BINS as f64),
        ("TALLY_ENTRIES", t::TALLY_ENTRIES as f64),
        ("TALLY_ALIGNMENT", t::TALLY_ALIGNMENT as f64),
        ("SELECTED_NEAREST", t::SELECTED_NEAREST as f64),
        ("SELECTED_CASTS", t::SELECTED_CASTS as f64),
        ("OCCLUDER_TEXEL_PX", t::OCCLUDER_TEXEL_PX as f64),
        ("OCCLUDER_SLOPE_MAX", t::OCCLUDER_SLOPE_MAX as f64),
        ("OCCLUDER_FINE_HEIGHTS", t::OCCLUDER_FINE_HEIGHTS as f64),
        ("OCCLUDER_MARGIN", t::OCCLUDER_MARGIN as f64),
        ("PYRAMID_TOP", t::PYRAMID_TOP as f64),
        ("TEST_COLUMNS", t::TEST_COLUMNS as f64),
        ("TEST_ROWS", t::TEST_ROWS as f64),
        ("REDUCE_BLOCK", t::REDUCE_BLOCK as f64),
        ("REDUCE_GROUP_SIZE", t::REDUCE_GROUP_SIZE as f64),
        ("SHADOW_LIFT", t::SHADOW_LIFT as f64),
        ("SHADOW_FADE_RADII", t::SHADOW_FADE_RADII as f64),
        ("FLAG_REVERSED_DEPTH", t::FLAG_REVERSED_DEPTH as f64),
        ("FLAG_SHADOWS", t::FLAG_SHADOWS as f64),
        ("FLAG_FULL_DETAIL", t::FLAG_FULL_DETAIL as f64),
        ("FLAG_STILL", t::FLAG_STILL as f64),
        ("GROUND_PLAIN", t::GROUND_PLAIN as f64),
        ("CAPTURE_ALL_GROUPS", t::CAPTURE_ALL_GROUPS as f64),
        ("CAPTURE_WEIGHT_MIN", t::CAPTURE_WEIGHT_MIN as f64),
        ("CAPTURE_WEIGHT_OWN", t::CAPTURE_WEIGHT_OWN as f64),
        ("CAPTURE_DEPTH_REACH", t::CAPTURE_DEPTH_REACH as f64),
    ] {
        assert_eq!(value(name) as f32, host as f32, "{name}");
    }
}

/// What spirv-val says, or `None` where it is not installed.
fn spirv_val(words: &[u32]) -> Option<Result<(), String>> {
    let mut child = Command::new("spirv-val")
        .args(["--target-env", "vulkan1.1", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .ok()?;
    child
        .stdin
        .take()?
        .write_all(bytemuck::cast_slice(words))
        .ok()?;
    let output = child.wait_with_output().ok()?;
    Some(if output.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    })
}

#[test]
fn modules_are_valid_spirv() {
    for module in MODULES {
        match spirv_val(module.spirv) {
            None => {
                eprintln!("SKIPPED: spirv-val is not installed (apt install spirv-tools)");
                return;
            }
            Some(result) => assert_eq!(result, Ok(()), "{}", module.name),
        }
    }
    // And it does look: a module without its last words is refused.
    let cut = &MODULES[0].spirv[..MODULES[0].spirv.len() - 8];
    assert!(spirv_val(cut).is_some_and(|r| r.is_err()));
}

#[test]
fn the_lint_finds_what_it_is_for() {
    for (bad, good) in [
        (
            "uint i : SV_InstanceID",
            "uint i : SV_InstanceID // includes firstInstance",
        ),
        ("uint i : SV_StartInstanceLocation", "uint i : SV_VertexID"),
        (
            "[[vk::push_constant]] P p;",
            "[[vk::push_constant]] ConstantBuffer<P> p;",
        ),
        (
            "[[vk::binding(0, 0)]] AppendStructuredBuffer<uint> a;",
            "[[vk::binding(0, 0)]] RWStructuredBuffer<uint> a;",
        ),
        ("half3 color;", "float3 half_extent;"),
        (
            "[[vk::binding(0, 0)]] StructuredBuffer<float3> a;",
            "[[vk::binding(0, 0)]] StructuredBuffer<float4> a;",
        ),
        ("float3x4 m;", "row_major float3x4 m;"),
        (
            "Texture2D<float4> t : register(t0);",
            "[[vk::binding(1, 0)]] Texture2D<float4> t;",
        ),
        (
            "StructuredBuffer<uint> a;",
            "[[vk::binding(1, 0)]] StructuredBuffer<uint> a;",
        ),
        ("b.InterlockedAdd(0, 1, v);", "b.InterlockedAdd(0u, 1u, v);"),
        (
            "x = WavePrefixSum(v);",
            "x = WavePrefixSum(v) - v; // the scan is inclusive",
        ),
    ] {
        let found = lint::lint("a.hlsl", bad);
        assert_eq!(found.len().min(1), 1, "nothing found in: {bad}");
        assert!(found[0].starts_with("a.hlsl:1: "), "{found:?}");
        assert_eq!(lint::lint("a.hlsl", good), Vec::<String>::new(), "{good}");
    }
}
