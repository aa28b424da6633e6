//! Error curves of impostors: they rise, do not depend on chance, and see an atlas that shows nothing.

mod common;

use common::{assert_silent, baked_mascot, headless};
use throng::bake::baked::Baked;
use throng::bake::impostor::build::{ImpostorOptions, build};
use throng::bake::impostor::groups::Groups;
use throng::bake::impostor::{ErrorSample, Kind};
use throng::calibrate::error_curves;

/// The mascot with impostors that the renderer captures.
fn captured_mascot() -> Baked {
    let mut baked = baked_mascot();
    let mut headless = headless([16, 16]);
    let mut capturer = headless.capturer(&baked).expect("it uploads");
    let built = build(
        &baked,
        &Groups::by_rule(&baked),
        &ImpostorOptions::default(),
        &mut |batch| capturer.capture(batch),
        &mut |_| {},
    )
    .expect("impostors");
    drop(capturer);
    assert_silent(&headless);
    baked.impostors = Some(built.impostors);
    baked
}

fn curves(baked: &Baked) -> Vec<Vec<ErrorSample>> {
    let mut headless = headless([16, 16]);
    let mut shares = Vec::new();
    let curves = error_curves(&mut headless, baked, &mut |s| shares.push(s)).expect("curves");
    assert!(shares.is_sorted() && shares.last() == Some(&1.0));
    assert_silent(&headless);
    curves
}

#[test]
fn curves_rise_are_repeatable_and_see_an_empty_atlas() {
    let mut baked = captured_mascot();
    let kinds: Vec<Kind> = (baked.impostors.iter())
        .flat_map(|i| i.kinds.iter().map(|k| k.kind))
        .collect();
    assert_eq!(kinds, [Kind::Flat, Kind::Quad]);
    let good = curves(&baked);
    println!("{good:?}");
    assert_eq!(good.len(), 2);
    for curve in &good {
        assert!(curve.len() > 4);
        assert!(
            curve
                .iter()
                .all(|s| s.error_px.is_finite() && s.error_px >= 0.0)
        );
        assert!(curve.is_sorted_by(|a, b| a.height_px < b.height_px && a.error_px <= b.error_px));
        assert!(curve[0].error_px < 2.0, "far impostors look alike");
    }
    assert_eq!(
        curves(&baked),
        good,
        "the same character gives the same curves"
    );

    if let Some(impostors) = &mut baked.impostors {
        for color in &mut impostors.atlas.color {
            color[3] = 0;
        }
    }
    for (bad, good) in curves(&baked).iter().zip(&good) {
        let sum = |c: &[ErrorSample]| c.iter().map(|s| s.error_px).sum::<f32>();
        assert!(sum(bad) > 1.5 * sum(good), "{bad:?} against {good:?}");
    }
}
