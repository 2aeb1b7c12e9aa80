//! Why a whole call is refused. A bad pixel is never an error: it carries a
//! [`Status`](crate::maps::Status).

/// A call that cannot be carried out.
///
/// The enum is exhaustive: whoever maps errors to another language's, as the border to Python does,
/// learns of a new variant when it is compiled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// An argument's value cannot be used.
    #[error("{name}: {problem}")]
    Argument {
        /// The argument, as the caller knows it.
        name: &'static str,
        /// What is wrong with it and what would be right.
        problem: String,
    },
    /// Lights, views or sizes contradict each other or cannot determine what is asked.
    #[error("{name}: {problem}")]
    Geometry {
        /// The argument, as the caller knows it.
        name: &'static str,
        /// What is wrong with it and what would be right.
        problem: String,
    },
    /// There is no memory for something that is as large as the picture, or for the work on a part
    /// of it.
    #[error("not enough memory: {bytes} bytes are needed")]
    Memory {
        /// What was asked for, with what must stay free for small things.
        bytes: usize,
    },
    /// The caller asked the call to stop; its outputs are incomplete.
    #[error("cancelled")]
    Cancelled,
}

impl Error {
    /// An argument's value cannot be used.
    pub fn argument(name: &'static str, problem: impl Into<String>) -> Self {
        Self::Argument { name, problem: problem.into() }
    }

    /// Lights, views or sizes cannot determine what is asked.
    pub fn geometry(name: &'static str, problem: impl Into<String>) -> Self {
        Self::Geometry { name, problem: problem.into() }
    }
}

/// What a fallible call returns.
pub type Result<T> = core::result::Result<T, Error>;
