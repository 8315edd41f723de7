//! The project as a whole: layers of the code, licences and sources of the dependencies, and fusion of real pictures
//! against published figures.

mod architecture;
mod dependencies;
mod reference_fusion;
