//! Processes that end in the middle of what they do.
#![cfg(unix)]

#[path = "common/program.rs"]
mod program;

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use program::*;

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    entries
        .map(|e| {
            e.expect("an entry")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect()
}

/// Whoever ends a bake, with Ctrl-C or otherwise, finds no output, nothing half written, and the files of before as they were.
#[test]
fn an_interrupted_bake_leaves_nothing() {
    // Not SIGINT, which shells have processes in the background ignore.
    const TERMINATE: i32 = 15;
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("old.json");
    std::fs::write(&report, "before").unwrap();
    let start = |output: &str| -> Child {
        Command::new(env!("CARGO_BIN_EXE_throng"))
            .args(["bake", "builtin:dog", "-o"])
            .arg(folder.path().join(output))
            .arg("--report")
            .arg(&report)
            .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary runs")
    };
    // While it simplifies, and later, where that is not the end yet.
    let mut ended = 0;
    for (output, seconds) in [("dog.throng", 0.4), ("new/dog.throng", 3.0)] {
        let mut child = start(output);
        std::thread::sleep(Duration::from_secs_f64(seconds));
        if child.try_wait().unwrap().is_some() {
            eprintln!("SKIPPED: the bake was over within {seconds} seconds");
            break;
        }
        ended += 1;
        let id = child.id().to_string();
        let sent = Command::new("kill").args(["-TERM", &id]).status();
        assert!(sent.expect("kill runs").success());
        let status = child.wait().unwrap();
        assert_eq!(status.signal(), Some(TERMINATE), "{status}");
        assert_eq!(names(folder.path()), ["old.json"]);
        assert_eq!(std::fs::read(&report).unwrap(), b"before");
    }
    assert!(ended > 0, "a bake takes longer");
}

/// The same for one that ends while it writes: a limit on the size of files ends it after the first bytes.
#[test]
#[cfg(target_os = "linux")]
fn nothing_is_left_of_a_file_that_was_being_written() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let old = folder.path().join("tetra.throng");
    let bake = |shell: &str| {
        Command::new("sh")
            .args(["-c", shell, env!("CARGO_BIN_EXE_throng"), "bake"])
            .arg(&source)
            .args(["--impostors", "none", "-o"])
            .arg(&old)
            .output()
            .expect("a shell")
    };
    let whole = bake("exec \"$0\" \"$@\"");
    assert!(whole.status.success(), "{}", stderr(&whole));
    let before = std::fs::read(&old).unwrap();
    assert!(before.len() > 1024);
    let mut files = names(folder.path());
    let cut = bake("ulimit -f 1; exec \"$0\" \"$@\"");
    assert!(!cut.status.success(), "the limit holds");
    assert_eq!(std::fs::read(&old).unwrap(), before);
    let mut left = names(folder.path());
    files.sort();
    left.sort();
    assert_eq!(left, files);
}
