//! The project as a whole: layers, circles and size of the code, licences and sources of the dependencies.

mod architecture;
mod cases;
mod circles;
mod constants;
mod dependencies;
mod links;
mod size;
mod source;
mod syntax;
