//! The project as a whole: layers of the code, licences and sources of the dependencies.

mod architecture;
mod dependencies;
