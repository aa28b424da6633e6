//! Errors of the renderer: every one names the object and the reason.

use ash::vk;

/// Why the renderer could not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The Vulkan loader, or a driver, is not installed.
    #[error(
        "no Vulkan: {reason}; install the loader and a driver (Debian, Ubuntu: apt install libvulkan1 mesa-vulkan-drivers)"
    )]
    NoVulkan {
        /// What was missing.
        reason: String,
    },
    /// No device has that name or index.
    #[error("there is no device '{wanted}'; there are: {available}")]
    NoSuchDevice {
        /// The name or index that was asked for.
        wanted: String,
        /// Names of the devices that exist.
        available: String,
    },
    /// The device lacks something that [`crate::gpu::requirements`] lists.
    #[error("{device} lacks {feature}, which {needed_for} needs")]
    MissingFeature {
        /// Name of the device.
        device: String,
        /// The feature, format or limit.
        feature: String,
        /// What would not work without it.
        needed_for: String,
    },
    /// A limit of the device or of the renderer's description is too small for what was asked.
    #[error("{object}: {needed} {unit} are needed and the limit is {limit}; {hint}")]
    Limit {
        /// What is too large.
        object: String,
        /// What it needs.
        needed: u64,
        /// What there may be.
        limit: u64,
        /// Of what.
        unit: &'static str,
        /// What can be done about it.
        hint: &'static str,
    },
    /// A baked character breaks a rule of its format.
    #[error("character '{character}': {place}: {reason}")]
    BadCharacter {
        /// Its name.
        character: String,
        /// Which of its arrays.
        place: String,
        /// What is wrong.
        reason: String,
    },
    /// An agent names a character or clip that does not exist, or a number in it is not finite.
    #[error("agent {index}: {reason}")]
    BadAgent {
        /// Its place in the slice.
        index: usize,
        /// What is wrong.
        reason: String,
    },
    /// A view or an option is out of range.
    #[error("{option}: {reason}")]
    BadOption {
        /// Which one.
        option: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// A call came before the one that it builds on.
    #[error("{call}: {reason}")]
    Order {
        /// The call that came too early.
        call: &'static str,
        /// What has to come first.
        reason: &'static str,
    },
    /// Vulkan refused a call.
    #[error("{object}: {call}: {source}")]
    Vulkan {
        /// Name of the object.
        object: String,
        /// The call.
        call: &'static str,
        /// What Vulkan said.
        source: vk::Result,
    },
    /// Memory could not be allocated.
    #[error("{object}: {source}")]
    Memory {
        /// Name of the object.
        object: String,
        /// What the allocator said.
        source: gpu_allocator::AllocationError,
    },
}

impl RenderError {
    /// [`RenderError::Vulkan`] for `map_err`.
    pub(crate) fn vulkan(
        object: impl Into<String>,
        call: &'static str,
    ) -> impl FnOnce(vk::Result) -> Self {
        // The name is only made where there is an error.
        move |source| Self::Vulkan {
            object: object.into(),
            call,
            source,
        }
    }
}
