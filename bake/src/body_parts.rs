//! Body parts, for colour variety: one for each material of the source, and how far an agent's tint may change it.

use std::collections::BTreeMap;
use std::path::Path;

use crate::baked::{Baked, BodyPart, Tint};
use crate::character::Character;
use crate::error::ImportError;
use crate::words::words;

/// Beginnings of words in the names of materials.
const SKIN: &[&str] = &["skin", "flesh"];
const HAIR: &[&str] = &["hair", "brows", "eyebrow", "beard", "moustache", "mustache"];
const FIXED: &[&str] = &[
    "eye", "teeth", "tooth", "mouth", "tongue", "lip", "face", "pupil", "lens", "metal", "weapon",
];
const NATURAL: &[&str] = &[
    "body", "fur", "hoof", "mane", "hand", "head", "muzzle", "nose", "horn", "feather", "main",
];
const CLOTHES: &[&str] = &[
    "shirt", "trouser", "pant", "shoe", "boot", "sock", "cloth", "dress", "skirt", "suit",
    "jacket", "coat", "hood", "hat", "cap", "tie", "vest", "short", "scarf", "glove", "belt",
    "helmet", "sweater", "jean", "bag", "top", "bottom", "sleeve",
];
/// Colours that a person has only in clothes.
const CLOTH_COLORS: &[&str] = &[
    "red",
    "orange",
    "yellow",
    "lime",
    "green",
    "cyan",
    "turquoise",
    "blue",
    "navy",
    "purple",
    "violet",
    "magenta",
    "pink",
    "white",
];

/// One body part per source material, with the rule that its name suggests.
pub fn body_parts(character: &Character) -> Vec<BodyPart> {
    let is_person = character.materials.iter().any(|m| says(&m.name, SKIN));
    let parts = character.materials.iter().map(|m| BodyPart {
        name: m.name.clone(),
        tint: rule(&m.name, m.base_color_image.is_some(), is_person),
    });
    parts.collect()
}

/// How far a tint may go, by the words of a material's name.
fn rule(name: &str, textured: bool, is_person: bool) -> Tint {
    let says = |list| says(name, list);
    if textured {
        // A texture may hold skin and clothes at once, so it stays as it is unless the name says what it is; and it keeps its
        // colours, which a cloth's tint would replace.
        let one = [SKIN, HAIR, NATURAL, CLOTHES].into_iter().any(says) && !says(FIXED);
        return if one { Tint::Natural } else { Tint::Fixed };
    }
    if is_person && says(SKIN) {
        Tint::Skin
    } else if is_person && says(HAIR) {
        Tint::Hair
    } else if says(FIXED) {
        Tint::Fixed
    } else if says(SKIN) || says(HAIR) || says(NATURAL) {
        Tint::Natural
    } else if says(CLOTHES) || (is_person && is_cloth_color(name)) {
        Tint::Cloth
    } else {
        // A plain colour of unknown meaning: people expect it to look as it was made.
        Tint::Natural
    }
}

fn says(name: &str, list: &[&str]) -> bool {
    let words = words(name);
    list.iter()
        .any(|w| words.iter().any(|word| word.starts_with(w)))
}

fn is_cloth_color(name: &str) -> bool {
    words(name)
        .iter()
        .any(|w| CLOTH_COLORS.contains(&w.as_str()))
}

/// Changes rules as a sidecar file states them: a TOML table from names of materials to `fixed`, `natural`, `cloth`, `skin` or
/// `hair`. Parts that it does not name keep theirs. It has to come before impostors are captured.
///
/// Errors: [`ImportError::Malformed`] where the TOML is broken, or a material or rule does not exist. `path` is for messages.
pub fn apply_sidecar(path: &Path, text: &str, baked: &mut Baked) -> Result<(), ImportError> {
    let bad = |place: &str, reason: String| ImportError::malformed(path, place, reason);
    let rules: BTreeMap<String, String> =
        toml::from_str(text).map_err(|e| bad("tints", e.to_string().trim_end().into()))?;
    for (name, rule) in &rules {
        let place = format!("material '{name}'");
        let tint = match rule.as_str() {
            "fixed" => Tint::Fixed,
            "natural" => Tint::Natural,
            "cloth" => Tint::Cloth,
            "skin" => Tint::Skin,
            "hair" => Tint::Hair,
            other => {
                let reason = format!("'{other}' is not fixed, natural, cloth, skin or hair");
                return Err(bad(&place, reason));
            }
        };
        let mut found = false;
        for part in baked.body_parts.iter_mut().filter(|p| p.name == *name) {
            (part.tint, found) = (tint, true);
        }
        if !found {
            let names: Vec<&str> = baked.body_parts.iter().map(|p| p.name.as_str()).collect();
            let reason = format!("there is none; the character has: {}", names.join(", "));
            return Err(bad(&place, reason));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_a_part_is() {
        let plain = |name| rule(name, false, true);
        assert_eq!(plain("Skin"), Tint::Skin);
        assert_eq!(plain("Hair_Blond"), Tint::Hair);
        assert_eq!(plain("Eyebrows"), Tint::Hair);
        assert_eq!(plain("Eye"), Tint::Fixed);
        assert_eq!(plain("Worker_Vest"), Tint::Cloth);
        assert_eq!(plain("TShirt"), Tint::Cloth);
        // Clothes by their colours.
        for name in ["LightBlue", "LimeGreen", "Purple", "WHITE", "Worker_Yellow"] {
            assert_eq!(plain(name), Tint::Cloth, "{name}");
        }
        // Shoes, belts or hair.
        for name in ["Brown2", "Black", "Mirrored_Material"] {
            assert_eq!(plain(name), Tint::Natural, "{name}");
        }
        // An animal's.
        assert_eq!(rule("Hair", false, false), Tint::Natural);
        assert_eq!(rule("Main_Light", false, false), Tint::Natural);
        assert_eq!(rule("White", false, false), Tint::Natural);
        // Textures keep their colours.
        assert_eq!(rule("fox_material", true, false), Tint::Fixed);
        assert_eq!(rule("Skin", true, true), Tint::Natural);
        assert_eq!(rule("shirt", true, true), Tint::Natural);
    }

    #[test]
    fn a_sidecar_file_says_rules_and_its_mistakes_are_named() {
        let mut baked = Baked {
            body_parts: ["Hull", "Deck"]
                .map(|name| BodyPart {
                    name: name.into(),
                    tint: Tint::Natural,
                })
                .to_vec(),
            ..Baked::default()
        };
        let path = Path::new("ship.tints.toml");
        apply_sidecar(path, "Deck = \"cloth\"", &mut baked).expect("it is right");
        assert_eq!(baked.body_parts[0].tint, Tint::Natural);
        assert_eq!(baked.body_parts[1].tint, Tint::Cloth);
        for (text, words) in [
            ("Deck = [", "line 1"),
            ("Deck = \"wood\"", "'wood' is not"),
            (
                "Sail = \"cloth\"",
                "material 'Sail': there is none; the character has: Hull, Deck",
            ),
        ] {
            let error = apply_sidecar(path, text, &mut baked)
                .expect_err(text)
                .to_string();
            assert!(
                error.starts_with("ship.tints.toml: ") && error.contains(words),
                "{error}"
            );
        }
    }

    #[test]
    fn skin_is_one_tint_and_clothes_are_many() {
        let part = |tint| BodyPart {
            name: "x".into(),
            tint,
        };
        assert_eq!(part(Tint::Skin).code(3), part(Tint::Skin).code(7));
        assert_ne!(part(Tint::Cloth).code(3), part(Tint::Cloth).code(7));
        assert_eq!(part(Tint::Cloth).code(200), 128 + 63);
        assert_eq!(part(Tint::Fixed).code(200), 63);
    }
}
