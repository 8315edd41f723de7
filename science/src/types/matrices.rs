//! Matrices as other programs leave them, made into the homographies of a profile.

use super::{Error, ErrorKind, Homography, Warning, error::ErrorLocation, profile::MAX_SLICES};

/// Which way the matrices of a file map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Slice pixel -> reference pixel, as a profile has them.
    #[default]
    SliceToReference,
    /// Reference pixel -> slice pixel: what OpenCV's `findHomography(reference, slice)` gives.
    ReferenceToSlice,
}

/// Homographies of one stack in the form of a profile.
#[derive(Debug, Clone, PartialEq)]
pub struct Based {
    /// One per slice, slice pixel -> reference-slice pixel; the one of the reference is the identity.
    pub homographies: Vec<Homography>,
    /// Which slice that is.
    pub reference_index: u32,
    /// What was done to the matrices.
    pub warnings: Vec<Warning>,
}

/// How far a matrix may send a corner of the image, px, and still count as the identity.
const STILL_PX: f64 = 0.01;

/// Normalises `matrices` (row-major) of slices of `width` x `height` px so that the last element is 1, turns them round
/// where they map the other way, and bases them on the reference slice: `reference`, else the slice whose matrix is the
/// identity (of several the one nearest the middle), else the middle slice.
///
/// # Errors
/// [`ErrorKind::InvalidProfile`] with a place per slice: matrices of zeros or of numbers that are not finite, matrices that
/// have no inverse, too few or too many, a reference that is none of them.
pub fn based(
    matrices: &[[f64; 9]],
    direction: Direction,
    reference: Option<u32>,
    width: u32,
    height: u32,
) -> Result<Based, Error> {
    let count = matrices.len();
    if !(2..=MAX_SLICES).contains(&count) {
        let detail = format!("{count} matrices; a stack has 2 to {MAX_SLICES} slices");
        return Err(Error::new(ErrorKind::InvalidProfile, detail));
    }
    if let Some(reference) = reference.filter(|&index| index as usize >= count) {
        let detail = format!("reference_index is {reference}; it must be below the {count} slices");
        return Err(Error::new(ErrorKind::InvalidProfile, detail));
    }
    refuse(
        matrices,
        |m| m.iter().all(|&v| v == 0.0),
        "nothing but zeros for a matrix; the program that made the file failed on them: measure them again, or leave them out of the stack",
    )?;
    refuse(matrices, |m| m.iter().any(|v| !v.is_finite()), "numbers that are not finite (NaN or infinity)")?;

    let normalised: Vec<Option<Homography>> = matrices
        .iter()
        .map(|m| {
            let homography = Homography::from_matrix(&Homography(*m).matrix())?;
            match direction {
                Direction::SliceToReference => Some(homography),
                Direction::ReferenceToSlice => homography.inverse(),
            }
        })
        .collect();
    refuse(&normalised, Option::is_none, "a singular matrix, or one whose last element is zero")?;
    let given: Vec<Homography> = normalised.into_iter().flatten().collect();

    let moves = |h: &Homography| h.corner_distance(&Homography::IDENTITY, width, height);
    let reference = reference.map_or_else(|| still_or_middle(&given, moves), |index| index as usize);
    let Some(base) = given.get(reference).copied() else {
        return Err(Error::new(ErrorKind::InvalidProfile, "no slice can be the reference"));
    };
    let index = u32::try_from(reference).unwrap_or(u32::MAX);
    if base == Homography::IDENTITY {
        return Ok(Based { homographies: given, reference_index: index, warnings: Vec::new() });
    }
    let back = base.inverse();
    let rebased: Vec<Option<Homography>> = given.iter().map(|h| h.then(&back?)).collect();
    refuse(&rebased, Option::is_none, "a matrix that cannot be based on the reference slice")?;
    let mut homographies: Vec<Homography> = rebased.into_iter().flatten().collect();
    if let Some(own) = homographies.get_mut(reference) {
        // what rounding leaves of the identity
        *own = Homography::IDENTITY;
    }
    let moved = moves(&base);
    let mut warnings = Vec::new();
    if moved.is_nan() || moved > STILL_PX {
        warnings.push(Warning::new(
            "rebased",
            format!(
                "the matrix of slice {reference}, the reference, moved the corners of the image by up to {moved:.2} px \
                 instead of leaving them; all matrices were multiplied by its inverse, so that slice {reference} stays as it is"
            ),
        ));
    }
    Ok(Based { homographies, reference_index: index, warnings })
}

/// The slice whose matrix is the identity, of several the one nearest the middle; the middle when there is none.
fn still_or_middle(given: &[Homography], moves: impl Fn(&Homography) -> f64) -> usize {
    let middle = given.len() / 2;
    let still = given.iter().enumerate().filter(|(_, h)| moves(h) <= STILL_PX);
    still.map(|(i, _)| i).min_by_key(|i| i.abs_diff(middle)).unwrap_or(middle)
}

/// Refuses the slices that are wrong, all in one sentence and each in its place.
fn refuse<T>(slices: &[T], wrong: impl Fn(&T) -> bool, has: &str) -> Result<(), Error> {
    let wrong: Vec<usize> = slices.iter().enumerate().filter(|(_, slice)| wrong(slice)).map(|(i, _)| i).collect();
    let (named, verb) = match wrong.as_slice() {
        [] => return Ok(()),
        [one] => (format!("slice {one}"), "has"),
        [many @ .., last] => {
            let many: Vec<String> = many.iter().map(ToString::to_string).collect();
            (format!("slices {} and {last}", many.join(", ")), "have")
        }
    };
    let places = wrong.iter().map(|&i| ErrorLocation {
        detail: format!("slice {i} has {has}"),
        pointer: Some(format!("/homographies/{i}")),
        slice: u32::try_from(i).ok(),
        ..ErrorLocation::default()
    });
    let fault = Error::new(ErrorKind::InvalidProfile, format!("{named} {verb} {has}"));
    Err(places.fold(fault, Error::at))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (640, 480);

    fn zoom(scale: f64) -> Homography {
        Homography::similarity(scale, [320.0 * (1.0 - scale), 240.0 * (1.0 - scale)])
    }

    fn based_on(slices: &[Homography], direction: Direction, reference: Option<u32>) -> Result<Based, Error> {
        let matrices: Vec<[f64; 9]> = slices.iter().map(|h| h.0).collect();
        based(&matrices, direction, reference, SIZE.0, SIZE.1)
    }

    fn near(a: &Homography, b: &Homography) -> bool {
        a.corner_distance(b, SIZE.0, SIZE.1) < 1e-9
    }

    #[test]
    fn the_slice_whose_matrix_is_the_identity_is_the_reference() {
        let slices = [zoom(1.01), Homography::IDENTITY, zoom(0.99), zoom(0.98)];
        let got = based_on(&slices, Direction::SliceToReference, None).expect("sound");
        assert_eq!(got, Based { homographies: slices.to_vec(), reference_index: 1, warnings: vec![] });
    }

    #[test]
    fn of_several_identities_the_one_nearest_the_middle_is_the_reference() {
        let mut slices = vec![Homography::IDENTITY; 5];
        slices[2] = zoom(1.01);
        let got = based_on(&slices, Direction::SliceToReference, None).expect("sound");
        assert_eq!(got.reference_index, 1);
    }

    #[test]
    fn without_an_identity_all_are_based_on_the_middle_and_that_is_told() {
        let to_last = [zoom(1.04), zoom(1.03), zoom(1.02), zoom(1.01)];
        let got = based_on(&to_last, Direction::SliceToReference, None).expect("sound");
        assert_eq!((got.reference_index, got.homographies[2]), (2, Homography::IDENTITY));
        assert!(near(&got.homographies[0], &zoom(1.04 / 1.02)), "{got:?}");
        assert_eq!(got.warnings[0].code, "rebased");
        assert!(got.warnings[0].detail.contains("slice 2, the reference"), "{got:?}");
    }

    #[test]
    fn a_reference_that_is_asked_for_wins_over_an_identity() {
        let slices = [Homography::IDENTITY, zoom(0.99), zoom(0.98)];
        let got = based_on(&slices, Direction::SliceToReference, Some(2)).expect("sound");
        assert_eq!((got.reference_index, got.homographies[2]), (2, Homography::IDENTITY));
        assert!(near(&got.homographies[0], &zoom(1.0 / 0.98)), "{got:?}");
        assert!(based_on(&slices, Direction::SliceToReference, Some(3)).is_err());
    }

    #[test]
    fn matrices_of_the_other_direction_are_turned_round() {
        let slices = [zoom(1.01), Homography::IDENTITY, Homography::similarity(0.99, [3.0, -1.0])];
        let inverse = slices.map(|h| h.inverse().expect("invertible"));
        let got = based_on(&inverse, Direction::ReferenceToSlice, None).expect("sound");
        assert!(got.homographies.iter().zip(&slices).all(|(a, b)| near(a, b)), "{got:?}");
    }

    #[test]
    fn the_last_element_becomes_one_whatever_its_sign() {
        let scaled = [zoom(1.01), Homography::IDENTITY].map(|h| Homography(h.0.map(|v| v * -2.5)));
        let got = based_on(&scaled, Direction::SliceToReference, None).expect("sound");
        assert!(near(&got.homographies[0], &zoom(1.01)) && got.homographies[1] == Homography::IDENTITY, "{got:?}");
        assert_eq!(got.reference_index, 1);
    }

    #[test]
    fn slices_of_zeros_are_listed() {
        let zero = Homography([0.0; 9]);
        let slices = [zero, Homography::IDENTITY, zero, zero];
        let told = based_on(&slices, Direction::SliceToReference, None).expect_err("zeros are no homography");
        assert!(told.detail.starts_with("slices 0, 2 and 3 have nothing but zeros"), "{told}");
        assert_eq!(told.locations.iter().filter_map(|p| p.slice).collect::<Vec<_>>(), [0, 2, 3]);
        let nan = [Homography::IDENTITY, Homography([f64::NAN; 9])];
        let told = based_on(&nan, Direction::SliceToReference, None).expect_err("not a number");
        assert!(told.detail.starts_with("slice 1 has numbers that are not finite"), "{told}");
        let flat = [Homography::IDENTITY, Homography([1.0; 9])];
        let told = based_on(&flat, Direction::ReferenceToSlice, None).expect_err("singular");
        assert!(told.detail.starts_with("slice 1 has a singular matrix"), "{told}");
    }
}
