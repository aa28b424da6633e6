//! Compiles every entry point of hlsl/ to SPIR-V and embeds it. Errors name file and line. Also makes a key of the code that
//! baked characters follow from, by which the cache of the command line knows what is out of date.

use std::collections::hash_map::DefaultHasher;
use std::fmt::Write as _;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};

use glslang::include::{IncludeHandler, IncludeResult, IncludeType};
use glslang::{
    Compiler, CompilerOptions, Shader, ShaderInput, ShaderMessage, ShaderSource, ShaderStage,
    SourceLanguage, SpirvVersion, Target, VulkanVersion,
};

#[path = "hlsl/lint.rs"]
mod lint;

/// Module name, file, entry point, stage, defined names.
type ModuleRow = (
    &'static str,
    &'static str,
    &'static str,
    ShaderStage,
    &'static [&'static str],
);
/// The module reads records (hlsl/records.hlsli): it is compiled with `STORAGE`, too, under a name that ends in `_storage`.
const READS_RECORDS: &str = "READS_RECORDS";
const COMPUTE: ShaderStage = ShaderStage::Compute;
const VERTEX: ShaderStage = ShaderStage::Vertex;
const FRAGMENT: ShaderStage = ShaderStage::Fragment;
#[rustfmt::skip]
const MODULES: &[ModuleRow] = &[
    ("select_count", "select.hlsl", "CSCount", COMPUTE, &[READS_RECORDS]),
    ("select_scan", "select.hlsl", "CSScan", COMPUTE, &[READS_RECORDS]),
    ("select_scatter", "select.hlsl", "CSScatter", COMPUTE, &[READS_RECORDS]),
    ("select_count_unhidden", "select.hlsl", "CSCount", COMPUTE, &[READS_RECORDS, "OCCLUSION"]),
    ("select_count_occluders", "select.hlsl", "CSCountOccluders", COMPUTE, &[READS_RECORDS]),
    ("occlude_vs", "occlude.hlsl", "VSMain", VERTEX, &[READS_RECORDS]),
    ("occlude_reduce", "occlude.hlsl", "CSReduce", COMPUTE, &["REDUCE"]),
    ("occlude_reduce_top", "occlude.hlsl", "CSReduceTop", COMPUTE, &["REDUCE"]),
    ("mesh_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS]),
    ("mesh_packed_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "PACKED"]),
    ("mesh_ps", "mesh.hlsl", "PSMain", FRAGMENT, &[]),
    ("mesh_textured_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "TEXTURED"]),
    ("mesh_textured_packed_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "PACKED", "TEXTURED"]),
    ("mesh_textured_ps", "mesh.hlsl", "PSMain", FRAGMENT, &["TEXTURED"]),
    ("mesh_double_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "DOUBLE_SIDED"]),
    ("mesh_double_packed_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "PACKED", "DOUBLE_SIDED"]),
    ("mesh_double_ps", "mesh.hlsl", "PSMain", FRAGMENT, &["DOUBLE_SIDED"]),
    ("mesh_textured_double_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "TEXTURED", "DOUBLE_SIDED"]),
    ("mesh_textured_double_packed_vs", "mesh.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "PACKED", "TEXTURED", "DOUBLE_SIDED"]),
    ("mesh_textured_double_ps", "mesh.hlsl", "PSMain", FRAGMENT, &["TEXTURED", "DOUBLE_SIDED"]),
    ("mesh_probe", "mesh_probe.hlsl", "CSMain", COMPUTE, &[READS_RECORDS]),
    ("impostor_vs", "impostor.hlsl", "VSMain", VERTEX, &[READS_RECORDS]),
    ("impostor_ps", "impostor.hlsl", "PSMain", FRAGMENT, &[]),
    ("impostor_soft_vs", "impostor.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "SOFT", "RELIEF"]),
    ("impostor_soft_ps", "impostor.hlsl", "PSMain", FRAGMENT, &["SOFT", "RELIEF"]),
    ("impostor_plain_vs", "impostor.hlsl", "VSMain", VERTEX, &[READS_RECORDS, "SOFT"]),
    ("impostor_plain_ps", "impostor.hlsl", "PSMain", FRAGMENT, &["SOFT"]),
    ("capture_vs", "capture.hlsl", "VSMain", VERTEX, &[READS_RECORDS]),
    ("capture_ps", "capture.hlsl", "PSMain", FRAGMENT, &[]),
    ("impostor_probe", "impostor_probe.hlsl", "CSMain", COMPUTE, &[READS_RECORDS]),
    ("impostor_soft_probe", "impostor_probe.hlsl", "CSMain", COMPUTE, &[READS_RECORDS, "SOFT"]),
    ("limit_mesh_cs", "limit.hlsl", "CSTransform", COMPUTE, &[READS_RECORDS, "TRANSFORM"]),
    ("limit_mesh_vs", "limit.hlsl", "VSLimit", VERTEX, &[]),
    ("limit_mesh_textured_cs", "limit.hlsl", "CSTransform", COMPUTE, &[READS_RECORDS, "TRANSFORM", "TEXTURED"]),
    ("limit_mesh_textured_vs", "limit.hlsl", "VSLimit", VERTEX, &["TEXTURED"]),
    ("limit_mesh_double_cs", "limit.hlsl", "CSTransform", COMPUTE, &[READS_RECORDS, "TRANSFORM", "DOUBLE_SIDED"]),
    ("limit_mesh_double_vs", "limit.hlsl", "VSLimit", VERTEX, &["DOUBLE_SIDED"]),
    ("limit_mesh_textured_double_cs", "limit.hlsl", "CSTransform", COMPUTE, &[READS_RECORDS, "TRANSFORM", "TEXTURED", "DOUBLE_SIDED"]),
    ("limit_mesh_textured_double_vs", "limit.hlsl", "VSLimit", VERTEX, &["TEXTURED", "DOUBLE_SIDED"]),
    ("limit_impostor_cs", "limit.hlsl", "CSTransform", COMPUTE, &[READS_RECORDS, "TRANSFORM", "IMPOSTOR"]),
    ("limit_impostor_vs", "limit.hlsl", "VSLimit", VERTEX, &["IMPOSTOR"]),
    ("limit_impostor_soft_cs", "limit.hlsl", "CSTransform", COMPUTE, &[READS_RECORDS, "TRANSFORM", "IMPOSTOR", "SOFT", "RELIEF"]),
    ("limit_impostor_soft_vs", "limit.hlsl", "VSLimit", VERTEX, &["IMPOSTOR", "SOFT", "RELIEF"]),
    ("limit_impostor_plain_cs", "limit.hlsl", "CSTransform", COMPUTE, &[READS_RECORDS, "TRANSFORM", "IMPOSTOR", "SOFT"]),
    ("limit_impostor_plain_vs", "limit.hlsl", "VSLimit", VERTEX, &["IMPOSTOR", "SOFT"]),
    ("limit_floor_vs", "limit.hlsl", "VSFloor", VERTEX, &[]),
    ("limit_floor_ps", "limit.hlsl", "PSFloor", FRAGMENT, &[]),
    ("ground_vs", "ground.hlsl", "VSMain", VERTEX, &[]),
    ("ground_ps", "ground.hlsl", "PSMain", FRAGMENT, &[]),
    ("shadow_vs", "shadow.hlsl", "VSMain", VERTEX, &[]),
    ("shadow_ps", "shadow.hlsl", "PSMain", FRAGMENT, &[]),
    ("sky_vs", "sky.hlsl", "VSMain", VERTEX, &[]),
    ("sky_ps", "sky.hlsl", "PSMain", FRAGMENT, &[]),
];

/// Hands out the files of hlsl/ to `#include`.
struct Includes(PathBuf);

impl IncludeHandler for Includes {
    fn include(&mut self, _: IncludeType, name: &str, _: &str, _: usize) -> Option<IncludeResult> {
        let data = std::fs::read_to_string(self.0.join(name)).ok()?;
        Some(IncludeResult {
            name: name.into(),
            data,
        })
    }
}

fn main() {
    if let Err(message) = run() {
        eprintln!("{message}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), String> {
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR").map_err(|e| e.to_string())?);
    let out = PathBuf::from(std::env::var("OUT_DIR").map_err(|e| e.to_string())?);
    let hlsl = root.join("hlsl");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=hlsl");
    println!("cargo:rustc-env=THRONG_BAKE_CODE={}", bake_code_key(&root)?);

    let mut findings = Vec::new();
    for entry in std::fs::read_dir(&hlsl).map_err(|e| format!("{}: {e}", hlsl.display()))? {
        let path = entry.map_err(|e| e.to_string())?.path();
        println!("cargo:rerun-if-changed={}", path.display());
        if path
            .extension()
            .is_some_and(|e| e == "hlsl" || e == "hlsli")
        {
            findings.extend(lint::lint(&path.display().to_string(), &read(&path)?));
        }
    }
    if !findings.is_empty() {
        findings.sort();
        return Err(findings.join("\n"));
    }

    let compiler = Compiler::acquire().ok_or("glslang does not start")?;
    let mut code = String::from("// Written by build.rs.\n");
    let mut table = String::new();
    let modules = MODULES
        .iter()
        .flat_map(|&(name, file, entry, stage, defines)| {
            let storage = defines
                .contains(&READS_RECORDS)
                .then(|| (format!("{name}_storage"), [defines, &["STORAGE"]].concat()));
            let plain = (name.to_string(), defines.to_vec());
            let both = std::iter::once(plain).chain(storage);
            both.map(move |(name, defines)| (name, file, entry, stage, defines))
        });
    for (name, file, entry, stage, defines) in modules {
        let words = compile(compiler, &hlsl, file, entry, stage, &defines)?;
        write!(
            code,
            "static {}: [u32; {}] = [",
            name.to_uppercase(),
            words.len()
        )
        .ok();
        for word in &words {
            write!(code, "{word},").ok();
        }
        code.push_str("];\n");
        writeln!(
            table,
            "    Module {{ name: {name:?}, source: \"hlsl/{file}\", spirv: &{} }},",
            name.to_uppercase()
        )
        .ok();
    }
    write!(
        code,
        "/// Every compiled entry point, by name.\npub static MODULES: &[Module] = &[\n{table}];\n"
    )
    .ok();
    let path = out.join("shaders.rs");
    std::fs::write(&path, code).map_err(|e| format!("{}: {e}", path.display()))
}

/// What decides how characters come out: the baker and its dependencies, the parameters of the built-in ones, and, because
/// impostors are pictures that the renderer takes, shaders and renderer. The rest of the command line and scenes do not.
fn bake_code_key(root: &Path) -> Result<String, String> {
    const SOURCES: [&str; 5] = ["Cargo.lock", "bake/src", "assets/characters", "hlsl", "src"];
    const WITHOUT: [&str; 3] = ["src/cli", "src/scene", "src/scene.rs"];
    const AGAIN: &str = "src/cli/impostors.rs";
    let mut hasher = DefaultHasher::new();
    let mut left: Vec<PathBuf> = SOURCES.iter().map(|s| root.join(s)).collect();
    left.push(root.join(AGAIN));
    let mut files = Vec::new();
    while let Some(path) = left.pop() {
        if WITHOUT.iter().any(|w| path == root.join(w)) {
            continue;
        }
        if path.is_dir() {
            let entries =
                std::fs::read_dir(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            for entry in entries {
                left.push(entry.map_err(|e| e.to_string())?.path());
            }
        } else if path.exists() {
            // Not the folders: a new file is only code once a file that is there names it.
            println!("cargo:rerun-if-changed={}", path.display());
            files.push(path);
        }
    }
    files.sort();
    for path in files {
        let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let name = path.strip_prefix(root).unwrap_or(&path);
        (name.to_string_lossy(), bytes).hash(&mut hasher);
    }
    Ok(format!("{:016x}", hasher.finish()))
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

fn compile(
    compiler: &'static Compiler,
    hlsl: &Path,
    file: &str,
    entry: &str,
    stage: ShaderStage,
    defines: &[&str],
) -> Result<Vec<u32>, String> {
    let options = CompilerOptions {
        source_language: SourceLanguage::HLSL,
        target: Target::Vulkan {
            version: VulkanVersion::Vulkan1_1,
            spirv_version: SpirvVersion::SPIRV1_3,
        },
        messages: ShaderMessage::VULKAN_RULES | ShaderMessage::SPV_RULES | ShaderMessage::READ_HLSL,
        version_profile: None,
    };
    // glslang prefixes messages with the name of an included file, and with 0 for the file itself.
    let name_files = |e: glslang::error::GlslangError| {
        let path = hlsl.join(file).display().to_string();
        let text = format!("{e}").replace("ERROR: 0:", &format!("ERROR: {path}:"));
        format!("{path}: entry point {entry}: {text}")
    };
    let source = ShaderSource::from(read(&hlsl.join(file))?);
    let mut includes = Includes(hlsl.to_path_buf());
    let defines: Vec<(&str, Option<&str>)> = defines.iter().map(|&d| (d, None)).collect();
    let input = ShaderInput::new(
        &source,
        stage,
        &options,
        Some(&defines),
        Some(&mut includes),
    )
    .map_err(name_files)?;
    let mut builder = Shader::new(compiler, input);
    builder.source_entry_point(entry);
    builder.entry_point("main");
    builder.invert_y(true);
    let shader = builder.parse().map_err(name_files)?;
    shader.compile().map_err(name_files)
}
