//! Which of a character's clips a scene means by a name.

use std::collections::BTreeMap;

use throng_bake::baked::Baked;
use throng_bake::words::words;

use super::SceneCrowd;

/// Names that stand for each other where a character has no clip of the one that is asked for, the likeliest first.
const SYNONYMS: [&[&str]; 3] = [
    &["walk", "stroll", "amble", "march", "trot"],
    &["run", "sprint", "jog", "gallop", "canter", "trot"],
    &["idle", "stand", "wait", "breath"],
];

/// What the user is to hear of clips that were looked up.
#[derive(Default)]
pub(super) struct Heard {
    /// Names that no clip has, one sentence each.
    pub warnings: Vec<String>,
    /// By character: what its clips were taken for.
    taken: BTreeMap<String, Vec<String>>,
}

impl Heard {
    /// A sentence for each character whose clips have other names than those asked for.
    pub fn notes(&self) -> Vec<String> {
        let sentence =
            |(name, list): (&String, &Vec<String>)| format!("{name}: {}", list.join(", "));
        self.taken.iter().map(sentence).collect()
    }
}

/// Index of each of the group's clips in the character. Hears of names that are not the clip's own but for case, and of those
/// that it has no clip for, once a character.
pub(super) fn look_up_clips(
    group: &SceneCrowd,
    character: &Baked,
    heard: &mut Heard,
) -> Vec<usize> {
    let clip_name = |i: usize| character.clips.get(i).map_or("none", |c| c.name.as_str());
    let names = character.clips.iter().map(|c| c.name.as_str());
    let mut indices = Vec::with_capacity(group.clips.len());
    for clip in &group.clips {
        let found = find_clip(names.clone(), &clip.name);
        let index = found.unwrap_or_else(|| standing_clip(character));
        let (asked, name) = (&clip.name, clip_name(index));
        if found.is_none() {
            let warning = format!(
                "{}: it has no clip '{asked}'; its clip '{name}' takes its place",
                character.name
            );
            // Other crowds may have said so before.
            if !heard.warnings.contains(&warning) {
                heard.warnings.push(warning);
            }
        } else if asked.to_lowercase() != name.to_lowercase() {
            let taken = format!("its clip '{name}' is taken for '{asked}'");
            let list = heard.taken.entry(character.name.clone()).or_default();
            if !list.contains(&taken) {
                list.push(taken);
            }
        }
        indices.push(index);
    }
    indices
}

/// How well a clip's name fits, the best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Fit {
    Equal,
    EqualButCase,
    /// Its last word begins so: `Man_Walk` and `Robot_Walking` for `walk`.
    LastWord,
    /// A word of it begins so: `Walking_A`, `WalkJump`.
    Word,
    /// The same, for a synonym of this place in its list.
    Synonym(usize),
    /// It holds the letters somewhere: `manwalk`.
    Letters,
}

/// Index of the clip that `name` means among a character's clip names.
///
/// An equal name, else one that is equal without regard to case, else one whose last word begins so (`Man_Walk`, `Walking` for
/// `walk`), else one in which any word does, else the same for synonyms of gaits and of standing (`Gallop` for `run`, `Trot` for
/// either gait), else one that contains the letters; the shortest of several.
pub fn find_clip<'a>(names: impl Iterator<Item = &'a str> + Clone, name: &str) -> Option<usize> {
    let wanted = name.to_lowercase();
    let lists = SYNONYMS
        .iter()
        .filter(|list| list.contains(&wanted.as_str()));
    let synonyms: Vec<&str> = lists.flat_map(|list| list.iter().copied()).collect();
    let fit = |candidate: &str| {
        if candidate == name {
            return Some(Fit::Equal);
        }
        if candidate.to_lowercase() == wanted {
            return Some(Fit::EqualButCase);
        }
        word_fit(candidate, &wanted).or_else(|| {
            let has = |synonym: &&str| word_fit(candidate, synonym).is_some();
            let synonym = synonyms.iter().position(has).map(Fit::Synonym);
            let has_letters = candidate.to_lowercase().contains(&wanted);
            synonym.or(has_letters.then_some(Fit::Letters))
        })
    };
    names
        .enumerate()
        .filter_map(|(i, n)| fit(n).map(|f| (f, n.len(), i)))
        .min()
        .map(|(.., i)| i)
}

/// Whether a word of the name begins with `wanted`, which is in small letters.
fn word_fit(name: &str, wanted: &str) -> Option<Fit> {
    let words = words(name);
    let begins = |word: &String| !wanted.is_empty() && word.starts_with(wanted);
    let at = words.iter().rposition(begins)?;
    Some(match at + 1 == words.len() {
        true => Fit::LastWord,
        false => Fit::Word,
    })
}

/// Index of the clip that a character stands in: its idle one, else its first.
pub fn standing_clip(character: &Baked) -> usize {
    find_clip(character.clips.iter().map(|c| c.name.as_str()), "idle").unwrap_or(0)
}
