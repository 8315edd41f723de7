//! Conversion of matrices from other programs into the homographies of a profile.

use super::{
    Error, ErrorKind, Homography, Warning, WarningCode,
    error::ErrorLocation,
    profile::{MAX_SLICES, reference_beyond},
};

/// Direction in which the matrices of a file map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Slice pixel -> reference pixel, as in a profile.
    #[default]
    SliceToReference,
    /// Reference pixel -> slice pixel, as returned by OpenCV's `findHomography(reference, slice)`.
    ReferenceToSlice,
}

/// Homographies of one stack, rebased on its reference slice.
#[derive(Debug, Clone, PartialEq)]
pub struct Rebased {
    /// One per slice, slice pixel -> reference-slice pixel; the reference slice has the identity.
    pub homographies: Vec<Homography>,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// Warnings about changes to the matrices.
    pub warnings: Vec<Warning>,
}

/// Largest movement of an image corner, px, by a matrix that counts as the identity.
const STILL_PX: f64 = 0.01;

/// Converts `matrices` (row-major) for slices of `width` x `height` px: normalises the last element to 1, inverts them
/// if they map the other way, and rebases them on the reference slice. The reference slice is `reference`, else the
/// slice whose matrix is the identity (of several the one nearest the middle), else the middle slice.
///
/// # Errors
/// [`ErrorKind::InvalidProfile`]. With a location per slice: matrices that are zero or not finite, whose last element
/// is nearly zero, or that cannot be inverted where that is needed. Without a location: fewer than 2 or more than
/// [`MAX_SLICES`] matrices. Other singular matrices are refused by [`super::profile::ProfileInput::check`].
pub fn rebase(
    matrices: &[[f64; 9]],
    direction: Direction,
    reference: Option<u32>,
    width: u32,
    height: u32,
) -> Result<Rebased, Error> {
    refuse_input(matrices, reference)?;
    let given = normalised(matrices, direction)?;
    let moves = |h: &Homography| h.corner_distance(&Homography::IDENTITY, width, height);
    let reference = reference.map_or_else(|| still_or_middle(&given, moves), |index| index as usize);
    let Some(base) = given.get(reference).copied() else {
        return Err(Error::new(ErrorKind::Internal, "the reference slice has no matrix"));
    };
    let index = u32::try_from(reference).unwrap_or(u32::MAX);
    if base == Homography::IDENTITY {
        return Ok(Rebased { homographies: given, reference_index: index, warnings: Vec::new() });
    }
    let Some(back) = base.inverse() else {
        let detail = format!(
            "the matrix of slice {reference}, the reference, is singular: measure it again, or set reference_index to \
             another slice"
        );
        let pointer = format!("/homographies/{reference}");
        return Err(Error::new(ErrorKind::InvalidProfile, detail).in_field(pointer, Some(index)));
    };
    let rebased: Vec<Option<Homography>> = given.iter().map(|h| h.then(&back)).collect();
    refuse(&rebased, Option::is_none, "a matrix that cannot be rebased on the reference slice")?;
    let mut homographies: Vec<Homography> = rebased.into_iter().flatten().collect();
    if let Some(own) = homographies.get_mut(reference) {
        // exactly the identity, without rounding errors
        *own = Homography::IDENTITY;
    }
    let moved = moves(&base);
    let mut warnings = Vec::new();
    if moved > STILL_PX {
        warnings.push(Warning::new(
            WarningCode::Rebased,
            format!(
                "the matrix of slice {reference}, the reference, was not the identity: it moved the image corners by up to \
                 {moved:.2} px; all matrices were multiplied by its inverse"
            ),
        ));
    }
    Ok(Rebased { homographies, reference_index: index, warnings })
}

/// Refuses a wrong number of matrices, a reference beyond them, and matrices of zeros or with numbers not finite.
fn refuse_input(matrices: &[[f64; 9]], reference: Option<u32>) -> Result<(), Error> {
    let count = matrices.len();
    if !(2..=MAX_SLICES).contains(&count) {
        let detail = format!("the file has {count} matrices; a stack must have 2 to {MAX_SLICES} slices");
        return Err(Error::new(ErrorKind::InvalidProfile, detail));
    }
    if let Some(reference) = reference.filter(|&index| index as usize >= count) {
        let detail = reference_beyond(reference as usize, count);
        return Err(Error::new(ErrorKind::InvalidProfile, detail).in_field("/reference_index", None));
    }
    refuse(
        matrices,
        |m| m.iter().all(|&v| v == 0.0),
        "nothing but zeros for a matrix: the program that made the file failed there; measure again, or omit these slices from the stack",
    )?;
    refuse(
        matrices,
        |m| m.iter().any(|v| !v.is_finite()),
        "numbers that are not finite (NaN or infinity); measure again, or omit these slices from the stack",
    )
}

/// The matrices as homographies from slice to reference.
fn normalised(matrices: &[[f64; 9]], direction: Direction) -> Result<Vec<Homography>, Error> {
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
    Ok(normalised.into_iter().flatten().collect())
}

/// The slice whose matrix is the identity, of several the one nearest the middle; without one the middle slice.
fn still_or_middle(given: &[Homography], moves: impl Fn(&Homography) -> f64) -> usize {
    let middle = given.len() / 2;
    let still = given.iter().enumerate().filter(|(_, h)| moves(h) <= STILL_PX);
    still.map(|(i, _)| i).min_by_key(|i| i.abs_diff(middle)).unwrap_or(middle)
}

/// An error that names all slices with the defect, with a location for each.
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
    let locations = wrong.iter().map(|&i| ErrorLocation {
        detail: format!("slice {i} has {has}"),
        pointer: Some(format!("/homographies/{i}")),
        slice: u32::try_from(i).ok(),
        ..ErrorLocation::default()
    });
    let error = Error::new(ErrorKind::InvalidProfile, format!("{named} {verb} {has}"));
    Err(locations.fold(error, Error::at))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (640, 480);

    fn zoom(scale: f64) -> Homography {
        Homography::similarity(scale, [320.0 * (1.0 - scale), 240.0 * (1.0 - scale)])
    }

    fn rebased_on(slices: &[Homography], direction: Direction, reference: Option<u32>) -> Result<Rebased, Error> {
        let matrices: Vec<[f64; 9]> = slices.iter().map(|h| h.0).collect();
        rebase(&matrices, direction, reference, SIZE.0, SIZE.1)
    }

    fn near(a: &Homography, b: &Homography) -> bool {
        a.corner_distance(b, SIZE.0, SIZE.1) < 1e-9
    }

    #[test]
    fn the_slice_whose_matrix_is_the_identity_is_the_reference() {
        let slices = [zoom(1.01), Homography::IDENTITY, zoom(0.99), zoom(0.98)];
        let got = rebased_on(&slices, Direction::SliceToReference, None).expect("sound");
        assert_eq!(got, Rebased { homographies: slices.to_vec(), reference_index: 1, warnings: vec![] });
    }

    #[test]
    fn of_several_identities_the_one_nearest_the_middle_is_the_reference() {
        let mut slices = vec![Homography::IDENTITY; 5];
        slices[2] = zoom(1.01);
        let got = rebased_on(&slices, Direction::SliceToReference, None).expect("sound");
        assert_eq!(got.reference_index, 1);
    }

    #[test]
    fn without_an_identity_all_are_rebased_on_the_middle_with_a_warning() {
        let to_last = [zoom(1.04), zoom(1.03), zoom(1.02), zoom(1.01)];
        let got = rebased_on(&to_last, Direction::SliceToReference, None).expect("sound");
        assert_eq!((got.reference_index, got.homographies[2]), (2, Homography::IDENTITY));
        assert!(near(&got.homographies[0], &zoom(1.04 / 1.02)), "{got:?}");
        assert_eq!(got.warnings[0].code, "rebased");
        assert!(got.warnings[0].detail.contains("slice 2, the reference"), "{got:?}");
    }

    #[test]
    fn a_requested_reference_takes_precedence_over_an_identity() {
        let slices = [Homography::IDENTITY, zoom(0.99), zoom(0.98)];
        let got = rebased_on(&slices, Direction::SliceToReference, Some(2)).expect("sound");
        assert_eq!((got.reference_index, got.homographies[2]), (2, Homography::IDENTITY));
        assert!(near(&got.homographies[0], &zoom(1.0 / 0.98)), "{got:?}");
        assert!(rebased_on(&slices, Direction::SliceToReference, Some(3)).is_err());
    }

    #[test]
    fn matrices_of_the_other_direction_are_inverted() {
        let slices = [zoom(1.01), Homography::IDENTITY, Homography::similarity(0.99, [3.0, -1.0])];
        let inverse = slices.map(|h| h.inverse().expect("invertible"));
        let got = rebased_on(&inverse, Direction::ReferenceToSlice, None).expect("sound");
        assert!(got.homographies.iter().zip(&slices).all(|(a, b)| near(a, b)), "{got:?}");
    }

    #[test]
    fn the_last_element_becomes_one_whatever_its_sign() {
        let scaled = [zoom(1.01), Homography::IDENTITY].map(|h| Homography(h.0.map(|v| v * -2.5)));
        let got = rebased_on(&scaled, Direction::SliceToReference, None).expect("sound");
        assert!(near(&got.homographies[0], &zoom(1.01)) && got.homographies[1] == Homography::IDENTITY, "{got:?}");
        assert_eq!(got.reference_index, 1);
    }

    #[test]
    fn slices_with_invalid_matrices_are_listed() {
        let zero = Homography([0.0; 9]);
        let slices = [zero, Homography::IDENTITY, zero, zero];
        let error = rebased_on(&slices, Direction::SliceToReference, None).expect_err("zeros are no homography");
        assert!(error.detail.starts_with("slices 0, 2 and 3 have nothing but zeros"), "{error}");
        assert_eq!(error.locations.iter().filter_map(|p| p.slice).collect::<Vec<_>>(), [0, 2, 3]);
        let nan = [Homography::IDENTITY, Homography([f64::NAN; 9])];
        let error = rebased_on(&nan, Direction::SliceToReference, None).expect_err("not a number");
        assert!(error.detail.starts_with("slice 1 has numbers that are not finite"), "{error}");
        let flat = [Homography::IDENTITY, Homography([1.0; 9])];
        let error = rebased_on(&flat, Direction::ReferenceToSlice, None).expect_err("singular");
        assert!(error.detail.starts_with("slice 1 has a singular matrix"), "{error}");
    }

    #[test]
    fn only_the_reference_is_blamed_for_its_singular_matrix() {
        let slices = [Homography([1.0; 9]), Homography::IDENTITY];
        let error = rebased_on(&slices, Direction::SliceToReference, Some(0)).expect_err("singular");
        assert!(error.detail.starts_with("the matrix of slice 0, the reference, is singular"), "{error}");
        assert_eq!(error.locations.iter().filter_map(|p| p.slice).collect::<Vec<_>>(), [0]);
    }
}
