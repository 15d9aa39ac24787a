//! What names may be: of bodies, muscles, coordinates, ratios. They become cells of tables, words on the terminal and labels of figures.

/// Longest name, in letters.
const LONGEST: usize = 200;

/// What is wrong with a name, if files, pages and spreadsheets cannot bear it.
pub fn flaw(name: &str) -> Option<String> {
    if name.is_empty() {
        return Some("it is empty".to_owned());
    }
    let letters = name.chars().count();
    if letters > LONGEST {
        return Some(format!("it has {letters} letters; {LONGEST} are the most"));
    }
    if crate::terminal::visible(name) != name || name.contains(['\n', '\t']) {
        return Some("it has a line break or another control character".to_owned());
    }
    is_formula(name).then(|| format!("it begins with `{}`, which spreadsheets take for a formula", &name[..1]))
}

/// Whether spreadsheets take a cell with this text for a formula.
pub fn is_formula(text: &str) -> bool {
    text.starts_with(['=', '+', '-', '@', '\t', '\r'])
}

/// A name as a message shows it: on one line, and its beginning if it is very long.
pub fn shown(name: &str) -> String {
    let name = name.replace('\n', "␊").replace('\t', "␉");
    match name.char_indices().nth(LONGEST / 4) {
        None => name,
        Some((end, _)) => format!("{}…", &name[..end]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_files_can_bear() {
        for good in ["biceps", "Adductor longus (left)", "a<b>&\"c\"", "M. biceps_2", "μ-fibre", "1st"] {
            assert_eq!(flaw(good), None, "{good}");
        }
        let long = "x".repeat(201);
        for bad in ["", "a\nb", "a\tb", "\u{1b}[31m", "\u{202e}a", "=1+1", "+a", "-a", "@a", &long] {
            assert!(flaw(bad).is_some(), "{bad}");
        }
        assert_eq!(shown(&long).chars().count(), 51);
        assert_eq!(shown("a\nb"), "a␊b");
    }
}
