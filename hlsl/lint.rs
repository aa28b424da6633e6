//! Finds HLSL that glslang compiles to something else than it says. build.rs runs it on every file; tests/shaders.rs shows
//! that each rule finds what it is for.

/// Findings in `source` as `file:line: what is wrong`.
pub fn lint(file: &str, source: &str) -> Vec<String> {
    let mut findings = Vec::new();
    let mut comment_before = "";
    for (number, line) in source.lines().enumerate() {
        let (code, comment) = line.split_once("//").unwrap_or((line, ""));
        for reason in findings_in(code, comment, comment_before) {
            findings.push(format!("{file}:{}: {reason}", number + 1));
        }
        comment_before = comment;
    }
    findings
}

fn findings_in(code: &str, comment: &str, comment_before: &str) -> Vec<&'static str> {
    let has = |word: &str| words(code).any(|w| w == word);
    let mut found = Vec::new();
    let explained = |s: &str| s.contains("includes firstInstance");
    if has("SV_InstanceID") && !explained(comment) && !explained(comment_before) {
        found.push(
            "SV_InstanceID is Vulkan's InstanceIndex; say 'includes firstInstance' in a comment here or on the line before",
        );
    }
    if has("SV_StartInstanceLocation")
        || has("SV_StartVertexLocation")
        || code.contains("vk::builtin")
    {
        found.push("this built-in becomes an ordinary input");
    }
    if code.contains("vk::push_constant") && !has("ConstantBuffer") {
        found.push("push constants that are no ConstantBuffer<T> become a uniform buffer");
    }
    if has("AppendStructuredBuffer")
        || has("ConsumeStructuredBuffer")
        || has("IncrementCounter")
        || has("DecrementCounter")
    {
        found.push("buffers with counters share one binding");
    }
    if words(code)
        .any(|w| w.starts_with("half") && w[4..].chars().all(|c| c.is_ascii_digit() || c == 'x'))
    {
        found.push("half is float; say float");
    }
    if has("WavePrefixSum") && !comment.contains("is inclusive") {
        found.push("its sum has the lane itself in it; subtract that, and say 'is inclusive' in a comment here");
    }
    if code.contains("StructuredBuffer<float3>") {
        found.push("its stride is 16, not 12; pad by hand");
    }
    if words(code).any(|w| w == "float3x4") && !has("row_major") {
        found.push("float3x4 takes 64 bytes; say row_major or use rows");
    }
    if has("register") {
        found.push("register collides between kinds; use vk::binding alone");
    }
    let resource = [
        "Texture2D",
        "Texture2DArray",
        "TextureCube",
        "SamplerState",
        "StructuredBuffer",
        "RWStructuredBuffer",
        "ConstantBuffer",
        "ByteAddressBuffer",
        "RWByteAddressBuffer",
    ];
    let first = words(code.rsplit("]]").next().unwrap_or("")).next();
    if first.is_some_and(|w| resource.contains(&w)) && !code.contains("[[vk::") {
        found.push("a resource without vk::binding gets binding 0 of set 0");
    }
    if code.contains("Interlocked") && (code.contains(", 1,") || code.contains("(0,")) {
        found.push("signed literals make invalid SPIR-V here; write 0u, 1u");
    }
    found
}

/// Identifiers and numbers of a line.
fn words(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !(c.is_alphanumeric() || c == '_'))
        .filter(|w| !w.is_empty())
}
