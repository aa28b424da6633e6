//! Built-in characters, made by code from parameters: the project needs nobody's model.
//!
//! A figure is modelled as layers of smoothly united signed-distance primitives (skin, hair, clothes), polygonised, cut
//! along the layers' borders, reduced to its triangle budget, and animated by analytic gaits with inverse kinematics, so
//! that a planted foot moves at exactly minus the clip's ground speed.

mod clothes;
mod cut;
mod dog;
mod dog_gait;
mod field;
mod figure;
mod gait;
mod head;
mod ik;
mod mesh;
mod params;
mod person;
mod polygonise;
mod tops;

use crate::character::Character;

/// The embedded parameter files by name.
const BUILT_IN: [(&str, &str); 9] = [
    (
        "man_suit",
        include_str!("../../../assets/characters/man_suit.toml"),
    ),
    (
        "woman_dress",
        include_str!("../../../assets/characters/woman_dress.toml"),
    ),
    (
        "man_hoodie",
        include_str!("../../../assets/characters/man_hoodie.toml"),
    ),
    (
        "worker",
        include_str!("../../../assets/characters/worker.toml"),
    ),
    (
        "jogger",
        include_str!("../../../assets/characters/jogger.toml"),
    ),
    (
        "old_man",
        include_str!("../../../assets/characters/old_man.toml"),
    ),
    (
        "woman_blouse",
        include_str!("../../../assets/characters/woman_blouse.toml"),
    ),
    (
        "man_cap",
        include_str!("../../../assets/characters/man_cap.toml"),
    ),
    ("dog", include_str!("../../../assets/characters/dog.toml")),
];

/// Why a character could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PeopleError {
    /// No built-in character has this name.
    #[error("there is no built-in character '{name}'; there are: {}", names().join(", "))]
    Unknown {
        /// What was asked for.
        name: String,
    },
    /// The parameters do not parse.
    #[error("character '{name}': {source}")]
    Parse {
        /// The character's name.
        name: String,
        /// Line, column and reason.
        source: Box<toml::de::Error>,
    },
    /// A parameter is out of range.
    #[error("character '{name}': {reason}")]
    Range {
        /// The character's name.
        name: String,
        /// Which parameter, its value and its range.
        reason: String,
    },
}

/// Names of the built-in characters.
pub fn names() -> Vec<&'static str> {
    BUILT_IN.iter().map(|b| b.0).collect()
}

/// Parameters of a built-in character as TOML: a start for one's own.
///
/// Errors: [`PeopleError::Unknown`].
pub fn parameters(name: &str) -> Result<&'static str, PeopleError> {
    let found = BUILT_IN.iter().find(|b| b.0 == name);
    found
        .map(|b| b.1)
        .ok_or_else(|| PeopleError::Unknown { name: name.into() })
}

/// Makes a built-in character: metres, +Y up, facing +Z, origin between the feet, clips `idle`, `walk` and `run`.
///
/// Same name, same character, bit for bit. Errors: [`PeopleError::Unknown`].
pub fn build(name: &str) -> Result<Character, PeopleError> {
    build_from_toml(name, parameters(name)?)
}

/// Makes a character called `name` from parameters such as those in `assets/characters`.
///
/// Errors: [`PeopleError::Parse`] and [`PeopleError::Range`].
pub fn build_from_toml(name: &str, text: &str) -> Result<Character, PeopleError> {
    let params: params::Params = toml::from_str(text).map_err(|e| PeopleError::Parse {
        name: name.into(),
        source: Box::new(e),
    })?;
    params.check().map_err(|reason| PeopleError::Range {
        name: name.into(),
        reason,
    })?;
    let mut character = match &params {
        params::Params::Person(p) => person::build(p),
        params::Params::Dog(d) => dog::build(d),
    };
    character.name = name.into();
    Ok(character)
}
