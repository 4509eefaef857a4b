//! The words by which names of the left and the right side differ.

/// Pairs of words in use, longer ones first: of two that explain as many names the first is taken.
const WORDS: [(&str, &str); 11] = [
    ("left", "right"),
    ("Left", "Right"),
    ("LEFT", "RIGHT"),
    ("_l_", "_r_"),
    ("_L_", "_R_"),
    ("l_", "r_"),
    ("L_", "R_"),
    ("_l", "_r"),
    ("_L", "_R"),
    ("L", "R"),
    ("l", "r"),
];

/// The words that tell the two sides of a robot apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sides {
    pub left: &'static str,
    pub right: &'static str,
}

impl Sides {
    /// The words that pair most of these names.
    pub fn find<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Option<Self> {
        let mut best = (0, None);
        for (left, right) in WORDS {
            let sides = Self { left, right };
            let is_there = |name: &str| names.clone().any(|other| other == name);
            let pairs = names
                .clone()
                .filter(|name| sides.of_left(name).is_some_and(|twin| is_there(&twin)));
            let count = pairs.count();
            if count > best.0 {
                best = (count, Some(sides));
            }
        }
        best.1
    }

    /// The name on the right of a name on the left.
    pub fn of_left(&self, name: &str) -> Option<String> {
        name.contains(self.left)
            .then(|| name.replacen(self.left, self.right, 1))
    }
}

/// What was found, for people.
pub(super) fn note(sides: Option<Sides>) -> String {
    match sides {
        Some(Sides { left, right }) => format!("left and right: names differ by `{left}` and `{right}`"),
        None => "left and right: no two names differ by a word for the side".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(names: &[&str]) -> Option<(&'static str, &'static str)> {
        Sides::find(names.iter().copied()).map(|sides| (sides.left, sides.right))
    }

    #[test]
    fn the_words_that_pair_most_names_are_taken() {
        assert_eq!(find(&["left_knee", "right_knee", "neck"]), Some(("left", "right")));
        assert_eq!(find(&["Knee_L", "Knee_R", "Hip_L", "Hip_R"]), Some(("_L", "_R")));
        assert_eq!(
            find(&["l_knee", "r_knee", "left_eye", "right_eye", "l_hip", "r_hip"]),
            Some(("l_", "r_"))
        );
    }

    #[test]
    fn names_without_a_twin_have_no_sides() {
        assert_eq!(find(&["left_knee", "shoulder", "elbow"]), None);
        assert_eq!(find(&[]), None);
    }
}
