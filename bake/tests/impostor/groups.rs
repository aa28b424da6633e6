//! Joint groups by rule and by sidecar file.

use std::collections::BTreeSet;
use std::path::Path;

use throng_bake::baked::Baked;
use throng_bake::impostor::groups::{Groups, RULE_GROUPS, RULE_GROUPS_WITHOUT_HANDS};
use throng_bake::sliding_tris::BandForm;

use crate::build::baked;
use crate::common::baked_sheets;

fn joint(baked: &Baked, name: &str) -> usize {
    let is_it = |j: &throng_bake::character::Joint| baked.nodes[j.node as usize].name == name;
    baked
        .joints
        .iter()
        .position(is_it)
        .unwrap_or_else(|| panic!("no joint {name}"))
}

fn check_sane(baked: &Baked, groups: &Groups) {
    assert_eq!(groups.of_joint.len(), baked.joints.len());
    for (g, group) in groups.groups.iter().enumerate() {
        assert_eq!(
            groups.of_joint[group.driver as usize] as usize, g,
            "a group's driver is in it"
        );
    }
    let used: BTreeSet<u8> = groups.of_joint.iter().copied().collect();
    assert!(used.iter().all(|&g| (g as usize) < groups.groups.len()));
}

#[test]
fn a_built_in_person_has_a_group_for_each_limb_and_a_head() {
    let baked = baked("man_suit").unwrap();
    let groups = Groups::by_rule(&baked);
    check_sane(&baked, &groups);
    assert!((10..=RULE_GROUPS).contains(&groups.groups.len()));
    let of = |name: &str| groups.of_joint[joint(&baked, name)];
    for side in ["l", "r"] {
        let limb = |part: &str| of(&format!("{part}_{side}"));
        assert_eq!(limb("hand"), limb("fingers"));
        assert_eq!(limb("foot"), limb("toes"));
        let parts = ["upper_arm", "forearm", "hand", "thigh", "shin", "foot"];
        let distinct: BTreeSet<u8> = parts.into_iter().map(limb).collect();
        assert_eq!(distinct.len(), parts.len());
    }
    assert_ne!(of("hand_l"), of("hand_r"));
    let heads: Vec<_> = groups.groups.iter().filter(|g| g.is_head).collect();
    assert_eq!(heads.len(), 1);
    assert_eq!(heads[0].driver as usize, joint(&baked, "head"));
}

#[test]
fn real_characters_have_few_groups_and_their_hands_hold_their_fingers() {
    let files = [
        ("glb/ped_man_suit.glb", "Hand.L", "Index3.L"),
        (
            "awkward/mh_male_163joints_8infl.glb",
            "wrist.R",
            "finger3-2.R",
        ),
        (
            "glb/horse_textured.glb",
            "back_leg_ankle_l",
            "back_leg_toe_l",
        ),
    ];
    for (file, limb, end) in files {
        let Some(baked) = baked(file) else { return };
        let groups = Groups::by_rule(&baked);
        check_sane(&baked, &groups);
        let count = groups.groups.len();
        assert!(
            (10..=RULE_GROUPS_WITHOUT_HANDS).contains(&count),
            "{file}: {count}"
        );
        let of = |name: &str| groups.of_joint[joint(&baked, name)];
        assert_eq!(of(limb), of(end), "{file}");
        assert_eq!(
            groups.groups.iter().filter(|g| g.is_head).count(),
            1,
            "{file}"
        );
    }
}

#[test]
fn a_sidecar_file_says_the_groups_and_its_mistakes_are_named() {
    let baked = baked_sheets(8, BandForm::Collapsed { ratio: 1.5 });
    let read = |text: &str| Groups::from_toml(Path::new("x.groups.toml"), text, &baked);
    let groups = read("top = [\"swing\"]\nbottom = [\"root\"]").unwrap();
    assert_eq!(
        groups.of_joint,
        [0, 1],
        "groups stand in the order of their names"
    );
    assert_eq!(groups.groups[1].name, "top");
    let whole = read("\"the head\" = [\"root\"]").unwrap();
    assert_eq!(
        whole.of_joint,
        [0, 0],
        "what is not listed goes with what it hangs in"
    );
    assert!(whole.groups[0].is_head);
    for (text, words) in [
        ("top = [", "line 1"),
        ("top = 3", "top"),
        ("", "there are 0 groups"),
        ("top = []", "group 'top': it lists no joint"),
        (
            "top = [\"swong\"]",
            "group 'top': there is no joint 'swong'",
        ),
        (
            "a = [\"root\"]\nb = [\"root\"]",
            "group 'b': joint 'root' is listed twice",
        ),
        ("top = [\"swing\"]", "joint 'root' moves vertices"),
    ] {
        let error = read(text).expect_err(text).to_string();
        assert!(
            error.starts_with("x.groups.toml: ") && error.contains(words),
            "{error}"
        );
    }
    let absent = Groups::from_sidecar(Path::new("absent.toml"), &baked).unwrap_err();
    assert!(absent.to_string().contains("absent.toml"));
}
