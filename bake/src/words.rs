//! What the names of joints and materials say.

/// The words of a name, in small letters, parted where people see them part: `LeftUpperArm.001` is left, upper, arm;
/// `TShirt` is t, shirt; `IKFrontLeg.L` is ik, front, leg, l; `WHITE` is one word.
pub fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut after_small = false;
    let mut chars = name.chars().peekable();
    while let Some(c) = chars.next() {
        let before_small = chars.peek().is_some_and(|next| next.is_lowercase());
        if !c.is_alphabetic() || (c.is_uppercase() && (after_small || before_small)) {
            words.push(String::new());
        }
        if let (true, Some(word)) = (c.is_alphabetic(), words.last_mut()) {
            word.extend(c.to_lowercase());
        }
        after_small = c.is_lowercase();
    }
    words.retain(|w| !w.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_part_where_people_see_them_part() {
        for (name, parts) in [
            ("LeftUpperArm.001", "left upper arm"),
            ("mixamorig:LeftToeBase", "mixamorig left toe base"),
            ("f_index.01.L", "f index l"),
            ("upperleg.l", "upperleg l"),
            ("Bip01 L UpperArm", "bip l upper arm"),
            ("IKFrontLeg.L", "ik front leg l"),
            ("LThigh", "l thigh"),
            ("TShirt", "t shirt"),
            ("LightBlue", "light blue"),
            ("WHITE", "white"),
            ("Ärmel_2", "ärmel"),
            ("007", ""),
            ("", ""),
        ] {
            assert_eq!(words(name).join(" "), parts, "{name}");
        }
    }
}
