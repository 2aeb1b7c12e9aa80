//! Why a picture was not made on the graphics card. Whoever asked may make it on the CPU.

/// What a fallible call returns.
pub type Result<T> = core::result::Result<T, Error>;

/// Why there is no picture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The scene or the surface is wrong, or the caller asked to stop: the CPU refuses it, too.
    #[error(transparent)]
    Refused(#[from] impasto::Error),
    /// No graphics card that the caller wants is there.
    #[error("{0}")]
    NoAdapter(String),
    /// The card has less memory than the painting needs.
    #[error("the graphics card {adapter} has too little memory: {problem}")]
    OutOfMemory {
        /// The card's name.
        adapter: String,
        /// What did not fit.
        problem: String,
    },
    /// The driver gave up on the card, or somebody unplugged it.
    #[error("the graphics card {adapter} was lost: {problem}")]
    DeviceLost {
        /// The card's name.
        adapter: String,
        /// The driver's message.
        problem: String,
    },
    /// What this renderer does not do, though the CPU's does.
    #[error("the graphics card cannot show this: {0}")]
    Unsupported(String),
    /// The driver refused what should be right.
    #[error("the driver of the graphics card {adapter} failed: {problem}")]
    Driver {
        /// The card's name.
        adapter: String,
        /// The driver's message.
        problem: String,
    },
}

impl Error {
    /// Of an error that wgpu reports.
    pub(crate) fn of(adapter: &str, error: &wgpu::Error) -> Self {
        let adapter = adapter.to_owned();
        match error {
            wgpu::Error::OutOfMemory { source } => {
                Self::OutOfMemory { adapter, problem: source.to_string() }
            }
            wgpu::Error::Validation { description, .. }
            | wgpu::Error::Internal { description, .. } => {
                Self::Driver { adapter, problem: description.clone() }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_of_the_driver_has_an_explanation() {
        let memory = wgpu::Error::OutOfMemory { source: "no room".into() };
        assert!(matches!(Error::of("A", &memory), Error::OutOfMemory { .. }));
        let description = "bad".to_owned();
        let wrong = wgpu::Error::Validation { source: "x".into(), description };
        assert_eq!(
            Error::of("A", &wrong).to_string(),
            "the driver of the graphics card A failed: bad"
        );
    }
}
