//! Errors of this crate: every one names the file, the place in it and the reason.

use std::path::{Path, PathBuf};

/// Why a source file could not be imported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The file, or a file that it names, could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file that could not be read.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The content breaks its format's rules.
    #[error("{}: {place}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Which object of the file.
        place: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The content is legal, and this importer does not read it.
    #[error("{}: {place}: {feature} is not supported{}", path.display(), if hint.is_empty() { String::new() } else { format!("; {hint}") })]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Which object of the file.
        place: String,
        /// The extension or feature.
        feature: String,
        /// What the user can do, or empty.
        hint: String,
    },
}

impl ImportError {
    /// [`ImportError::Malformed`] from borrowed parts.
    pub fn malformed(path: &Path, place: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_path_buf(),
            place: place.into(),
            reason: reason.into(),
        }
    }
}

/// Why an imported character could not be baked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The character needs more of something than a baked character can hold.
    #[error("{character}: {what}: {count}, and at most {limit} can be baked")]
    Limit {
        /// The character's name.
        character: String,
        /// What there is too much of.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// How many there may be.
        limit: u64,
    },
    /// Nothing would be left to draw.
    #[error("{character}: {reason}")]
    Empty {
        /// The character's name.
        character: String,
        /// What is missing.
        reason: &'static str,
    },
    /// A collapse sequence breaks its own rules: a fault of whoever made it.
    #[error("collapse {step}: {reason}")]
    Sequence {
        /// Number of the collapse.
        step: usize,
        /// Which rule.
        reason: &'static str,
    },
}

/// Why a baked file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The system refused.
    #[error("{}: {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The content is not a baked character of this version, or it is damaged.
    #[error("{}: {place}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Which section or record.
        place: String,
        /// What is wrong with it.
        reason: String,
    },
}
