//! The table of verdict against truth.

use pinstack_science::types::report::Grade;

use super::judge::Judgement;

/// One row per family, in order of appearance, then the total.
pub fn table(all: &[Judgement]) -> String {
    let mut text = format!(
        "{:<28}{:>7}{:>11}{:>11}{:>9}{:>11}{:>12}{:>12}{:>9}{:>12}{:>9}\n",
        "family",
        "stacks",
        "Good+right",
        "Good+wrong",
        "> 0.3 px",
        "> 3 sigma",
        "other+right",
        "downgraded",
        "refused",
        "gain untold",
        "named"
    );
    let mut families: Vec<&str> = Vec::new();
    for judgement in all {
        if !families.contains(&judgement.family) {
            families.push(judgement.family);
        }
    }
    for family in families {
        let of: Vec<&Judgement> = all.iter().filter(|judgement| judgement.family == family).collect();
        text.push_str(&row(family, &of));
    }
    text.push_str(&row("all", &all.iter().collect::<Vec<_>>()));
    text
}

fn row(name: &str, of: &[&Judgement]) -> String {
    let count = |test: &dyn Fn(&Judgement) -> bool| of.iter().filter(|judgement| test(judgement)).count();
    let good = |j: &Judgement| j.grade == Some(Grade::Good);
    let named = match (count(&|j| j.named.is_some()), count(&|j| j.named == Some(true))) {
        (0, _) => "-".to_owned(),
        (all, told) => format!("{told}/{all}"),
    };
    format!(
        "{name:<28}{:>7}{:>11}{:>11}{:>9}{:>11}{:>12}{:>12}{:>9}{:>12}{:>9}\n",
        of.len(),
        count(&|j| good(j) && !j.wrong && !j.dishonest),
        count(&|j| good(j) && (j.wrong || j.dishonest)),
        count(&|j| good(j) && j.wrong),
        count(&|j| good(j) && j.dishonest),
        count(&|j| j.grade.is_some() && !good(j) && !j.downgraded),
        count(&|j| j.downgraded && j.grade.is_some()),
        count(&|j| j.grade.is_none()),
        count(&|j| j.gain_untold),
        named
    )
}
