//! `throng bench` from outside: every experiment with tiny numbers. Counts, ratios and names; never milliseconds.

#[path = "common/program.rs"]
mod program;

use program::*;
use serde_json::Value;

/// Runs a small experiment on a scene of tetrahedra and returns its table and its JSON.
fn bench(name: &str, more: &[&str]) -> (String, Value) {
    let (folder, scene) = scene_of_tetrahedra();
    let report = folder.path().join("new/report.json");
    let fixed = [
        "bench",
        name,
        "--scene",
        &scene,
        "--size",
        "64x64",
        "--json",
        report.to_str().unwrap(),
    ];
    let said = succeed(&[&fixed[..], more].concat());
    (said, json(&std::fs::read_to_string(report).unwrap()))
}

fn entry<'a>(step: &'a Value, method: &str) -> &'a Value {
    let entries = step["entries"].as_array().unwrap();
    let found = entries.iter().find(|e| e["method"] == method);
    found.unwrap_or_else(|| panic!("no {method} in {step}"))
}

#[test]
fn every_method_is_measured_beside_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("methods.svg");
    let more = [
        "--agents",
        "100",
        "--runs",
        "2",
        "--plot",
        plot.to_str().unwrap(),
    ];
    let (said, results) = bench("methods", &more);
    for word in [
        "spread",
        "CPU ms",
        "x limit",
        "x floor",
        "vertex-shader runs",
        "impostor",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
    assert_eq!(results["experiment"], "methods");
    let setup = &results["setup"];
    assert_eq!(setup["limit_of"], "hybrid");
    assert_eq!(setup["runs"], 2);
    assert!(setup["device"].as_str().is_some_and(|d| !d.is_empty()));
    let step = &results["steps"][0];
    assert_eq!(step["agents"], 100);
    let methods = [
        "hybrid",
        "lod",
        "flat",
        "quad",
        "full",
        "uninstanced",
        "limit",
        "floor",
    ];
    assert_eq!(step["entries"].as_array().unwrap().len(), methods.len());
    for method in methods {
        let e = entry(step, method);
        assert_eq!(e["agents"], 100, "{method}");
        assert_eq!(e["visible"], entry(step, "full")["visible"], "{method}");
        assert_eq!(e["frame_ms"]["runs"], 2, "{method}");
        for list in ["frame_ms_each", "cpu_ms_each"] {
            assert_eq!(e[list].as_array().unwrap().len(), 2, "{method} {list}");
        }
        for key in ["median", "p95", "min", "spread"] {
            assert!(e["frame_ms"][key].is_number() && e["cpu_ms"][key].is_number());
        }
        assert!(e["warm_up_frames"].as_u64().unwrap() >= 2);
        assert!(e["to_limit"].is_number() && e["to_floor"].is_number());
        assert!(e["flip"].is_null());
        let stages: Vec<&str> = (e["stage_ms"].as_array().unwrap().iter())
            .filter_map(|s| s["stage"].as_str())
            .collect();
        assert!(
            stages.contains(&"mesh") && stages.contains(&"shadow"),
            "{stages:?}"
        );
    }
    assert_eq!(entry(step, "limit")["to_limit"], 1.0);
    assert_eq!(entry(step, "floor")["to_floor"], 1.0);
    assert_eq!(entry(step, "floor")["cpu_to_floor"], 1.0);
    let visible = entry(step, "full")["visible"].as_u64().unwrap();
    assert_eq!(entry(step, "full")["triangles"], 4 * visible);
    assert_eq!(entry(step, "uninstanced")["draw_calls"], visible + 3);
    let triangles = |method| entry(step, method)["triangles"].as_u64().unwrap();
    assert_eq!(triangles("limit"), triangles("floor"));
    assert!(triangles("limit") > 0 && triangles("limit") <= triangles("hybrid"));
    assert!(std::fs::read_to_string(plot).unwrap().contains("<svg"));
}

#[test]
fn cost_is_measured_over_the_number_of_agents() {
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("scale.svg");
    let more = [
        "--agents",
        "10,100",
        "--runs",
        "1",
        "--method",
        "lod",
        "--plot",
        plot.to_str().unwrap(),
    ];
    let (said, results) = bench("scale", &more);
    assert!(said.contains("us/agent"), "{said}");
    for (i, agents) in [10, 100].into_iter().enumerate() {
        let step = &results["steps"][i];
        assert_eq!(step["agents"], agents);
        assert_eq!(entry(step, "lod")["agents"], agents);
        assert!(entry(step, "limit")["us_per_agent"].is_number());
    }
    let calls = |i: usize| &entry(&results["steps"][i], "lod")["draw_calls"];
    assert_eq!(calls(0), calls(1));
    assert!(
        std::fs::read_to_string(plot)
            .unwrap()
            .contains("microseconds")
    );
}

#[test]
fn the_least_that_a_picture_can_cost_is_measured() {
    let (said, results) = bench("limit", &["--runs", "1", "--method", "quad"]);
    assert!(said.contains("the frame of quad"), "{said}");
    let step = &results["steps"][0];
    assert_eq!(step["entries"].as_array().unwrap().len(), 3);
    // Quads do not collapse.
    assert_eq!(
        entry(step, "limit")["triangles"],
        entry(step, "quad")["triangles"]
    );
}

/// Where Python's flip-evaluator is missing, it is said and the rest is measured.
#[test]
fn pictures_are_compared_where_python_can() {
    let more = ["--runs", "1", "--method", "full,quad", "--flip"];
    let (said, results) = bench("methods", &more);
    let step = &results["steps"][0];
    let error = |method| entry(step, method)["flip"].as_f64();
    match (error("full"), error("quad")) {
        (Some(full), Some(quad)) => assert!(full > 0.0 && full < quad && quad < 0.5, "{said}"),
        (None, None) => eprintln!("SKIPPED: flip-evaluator is not installed"),
        other => panic!("{other:?}"),
    }
}

/// Only along a camera that moves.
#[test]
fn pictures_along_a_path_are_compared_frame_by_frame() {
    let (folder, scene) = scene_of_tetrahedra();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (plot, report, pictures) = (file("path.svg"), file("path.json"), file("pictures"));
    let fixed = ["bench", "path", "--size", "64x64", "--scene", &scene];
    let refused = refuse(&fixed);
    assert!(refused.contains("path"), "{refused}");
    let text = std::fs::read_to_string(&scene).unwrap();
    let camera = r#"
        [[camera]]
        name = "flight"
        path = [
            { time = 0, position = [0, 6, 14], target = [0, 0, 0] },
            { time = 0.1, position = [0, 2, 9], target = [0, 0, 0] },
        ]
    "#;
    std::fs::write(&scene, text + camera).unwrap();
    assert!(refuse(&[&fixed[..], &["--camera", "near"]].concat()).contains("--camera"));
    let more = ["--supersample", "2", "--json", &report, "--plot", &plot];
    let keep = ["--pictures", &pictures];
    let output = throng(&[&fixed[..], &more, &keep].concat());
    if stderr(&output).contains("flip-evaluator") {
        eprintln!("SKIPPED: flip-evaluator is not installed");
        return;
    }
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stdout(&output).contains("flicker"));
    let results = json(&std::fs::read_to_string(report).unwrap());
    assert_eq!(results["setup"]["camera"], "flight");
    assert_eq!(results["setup"]["frames"], 3);
    let names: Vec<&str> = (results["methods"].as_array().unwrap().iter())
        .filter_map(|m| m["method"].as_str())
        .collect();
    assert_eq!(names, ["full", "lod", "hybrid"]);
    for method in results["methods"].as_array().unwrap() {
        for (series, count) in [("flip", 3), ("change", 2), ("flicker", 2)] {
            let series = method[series].as_array().unwrap();
            assert_eq!(series.len(), count);
            assert!(series.iter().all(|x| x.as_f64().is_some_and(|x| x > 0.0)));
        }
        let ratio = method["to_full"]["flip"]["mean"].as_f64().unwrap();
        assert!(ratio > 0.2 && ratio < 5.0, "{ratio}");
    }
    assert!(
        std::path::Path::new(&pictures)
            .join("hybrid_0002.png")
            .is_file()
    );
    assert!(std::fs::read_to_string(plot).unwrap().contains("<svg"));
}

#[test]
fn what_makes_no_sense_is_refused_by_name() {
    for (arguments, option) in [
        (&["bench", "methods", "--runs", "0"][..], "--runs"),
        (&["bench", "scale", "--agents", "0"], "--agents"),
        (&["bench", "height", "--method", "lod"], "--method"),
        (&["bench", "scale", "--flip"], "--flip"),
        (&["bench", "methods", "--method", "lod,lod"], "lod"),
        (&["bench", "methods", "--method", "best"], "best"),
        (&["bench", "limit", "--pixel-error", "nan"], "--pixel-error"),
        (&["bench", "ramos", "--plot", "a.svg"], "--plot"),
        (&["bench", "path", "--method", "full"], "full"),
        (&["bench", "path", "--agents", "10,20"], "--agents"),
        (&["bench", "limit", "--pictures", "a"], "--pictures"),
        (&["bench", "methods", "--scene", "moon"], "stampede"),
    ] {
        let message = refuse(arguments);
        assert!(message.contains(option), "{arguments:?}: {message}");
    }
    let help = succeed(&["bench", "--help"]);
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for word in [
        "methods",
        "scale",
        "limit",
        "floor",
        "takes turns",
        "spread",
        "--flip",
    ] {
        assert!(help.contains(word), "{word}");
    }
}

#[test]
fn the_paper_s_experiments_run() {
    let (folder, scene) = scene_of_tetrahedra();
    let report = folder.path().join("ramos.json");
    let fixed = [
        "bench", "ramos", "--scene", &scene, "--size", "64x64", "--runs", "2",
    ];
    let more = ["--agents", "5,20", "--json", report.to_str().unwrap()];
    let said = succeed(&[&fixed[..], &more].concat());
    assert!(said.contains("triangles full/lod") && said.contains("bytes per vertex"));
    let results = json(&std::fs::read_to_string(report).unwrap());
    let step = &results["steps"][1];
    assert_eq!(step["lod"]["agents"], 20);
    assert_eq!(step["lod"]["frame_ms_each"].as_array().unwrap().len(), 2);
    assert_eq!(step["full"]["triangles"], 80);
    assert!(step["ratios"]["triangles_full_to_lod"].as_f64().unwrap() >= 1.0);
}

/// Every representation at every height, with a plot of them.
#[test]
fn representations_are_measured_by_height() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (plot, report) = (path("new/height.svg"), path("height.json"));
    let fixed = ["bench", "height", "--size", "96x64", "--runs", "1"];
    let more = ["--character", source.to_str().unwrap()];
    let files = ["--plot", &plot, "--json", &report];
    let said = succeed(&[&fixed[..], &more, &files].concat());
    assert!(said.contains("hybrid/cheapest"));
    assert!(std::fs::read_to_string(plot).unwrap().contains("<svg"));
    let results = json(&std::fs::read_to_string(report).unwrap());
    let steps = results["steps"].as_array().unwrap();
    assert_eq!(steps[0]["height_px"], 4.0);
    assert_eq!(steps.last().unwrap()["height_px"], 400.0);
    for step in steps {
        assert_eq!(step["ms_per_1000"].as_array().unwrap().len(), 4);
    }
    assert!(refuse(&["bench", "ramos", "--plot", "a.svg"]).contains("--plot"));
}

#[test]
fn frames_are_streamed() {
    let (said, results) = bench("stream", &["--agents", "60", "--runs", "10"]);
    assert!(said.contains("frames in flight"), "{said}");
    let rows = results["rows"].as_array().unwrap();
    let in_flight: Vec<_> = rows
        .iter()
        .filter_map(|r| r["in_flight"].as_u64())
        .collect();
    assert_eq!(in_flight, [1, 2, 3]);
    for row in rows {
        let each = row["frame_ms_each"].as_array().unwrap();
        assert_eq!(each.len(), 10);
        assert!(each.iter().all(|ms| ms.as_f64().is_some_and(|ms| ms > 0.0)));
    }
}
