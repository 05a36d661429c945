//! Choosing and opening a GPU, and turning its faults into errors.

use std::sync::{Arc, Mutex, PoisonError, RwLock};

use thiserror::Error;

/// A connection to the display that windows will be made on.
pub type DisplayHandle = Box<dyn wgpu::wgt::WgpuHasDisplayHandle>;

/// How to open a GPU.
#[derive(Debug, Default)]
pub struct GpuOptions {
    /// The display, where windows are wanted; not needed to draw without one.
    pub display: Option<DisplayHandle>,
    /// To do without what a GPU may lack. For tests.
    pub without: Option<Optional>,
}

/// What is made use of where a GPU has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Optional {
    /// Depth tests that come before shaders which have effects.
    EarlyDepth,
    /// Draws whose arguments are in buffers.
    IndirectDraws,
}

/// Why the GPU does not do what it should.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum GpuError {
    #[error(
        "no GPU and no software renderer found; on Debian or Ubuntu, install one with: sudo apt-get install mesa-vulkan-drivers"
    )]
    NoAdapter,
    #[error("no GPU has a name that contains WGPU_ADAPTER_NAME=`{wanted}`; there are: {found}")]
    NotNamed { wanted: String, found: String },
    #[error("the GPU {adapter} does not open: {reason}")]
    Open { adapter: String, reason: String },
    #[error("the GPU was lost: {0}")]
    Lost(String),
    #[error("the GPU refused: {0}")]
    Refused(String),
    #[error("{what}: {value}, the GPU's limit is {limit}")]
    Limit { what: &'static str, value: u64, limit: u64 },
    #[error("view {0} is not one of this renderer's")]
    UnknownView(u16),
    #[error("the last picture was drawn without object ids")]
    NoIds,
    #[error("this GPU cannot tell what is hidden: it lacks indirect draws or shaders that write, or is driven through OpenGL")]
    NoCulling,
    #[error("the GPU cannot count: its fragment shaders write to no buffers")]
    NoCounts,
}

/// wgpu, and what it finds. Without windows OpenGL is the last resort: merely loading it is slow, and makes it write to
/// standard error where there is no desktop.
fn instance(display: Option<DisplayHandle>) -> (wgpu::Instance, Vec<wgpu::Adapter>) {
    let is_headless = display.is_none();
    let open = |display, without: wgpu::Backends| {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.display = display;
        // Indirect draws come from this process, which checks them where it writes them.
        descriptor.flags = wgpu::InstanceFlags::from_build_config() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL;
        let mut descriptor = descriptor.with_env();
        descriptor.backends -= without;
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        (instance, adapters)
    };
    if is_headless {
        let (instance, adapters) = open(None, wgpu::Backends::GL);
        if !adapters.is_empty() {
            return (instance, adapters);
        }
    }
    open(display, wgpu::Backends::empty())
}

/// What went wrong since someone last asked. wgpu reports asynchronously.
#[derive(Debug, Default)]
struct Faults {
    refused: Mutex<Option<String>>,
    lost: Mutex<Option<String>>,
}

/// An open GPU. Several renderers in one process share it.
#[derive(Debug)]
pub struct Gpu {
    pub(super) instance: wgpu::Instance,
    pub(super) adapter: wgpu::Adapter,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// Whether draws can be taken from a buffer, many at a time.
    pub(super) indirect: bool,
    /// Whether a shader that writes depth may promise which way it moves it.
    pub(super) early_depth: bool,
    /// Read while work is submitted, written while a surface changes: a surface waits for an idle GPU, and gives up
    /// when other threads keep it busy.
    submitting: RwLock<()>,
    faults: Arc<Faults>,
}

impl Gpu {
    /// Opens the best GPU: a discrete one before an integrated one before software. The environment may narrow the
    /// choice: `WGPU_BACKEND` (a list of vulkan, gl, metal, dx12) and `WGPU_ADAPTER_NAME` (part of a name).
    ///
    /// # Errors
    /// When there is none, none has the wanted name, or it does not open.
    pub fn open(options: GpuOptions) -> Result<Arc<Self>, GpuError> {
        let (instance, adapters) = instance(options.display);
        let wanted = std::env::var("WGPU_ADAPTER_NAME").ok();
        let adapter = choose(adapters, wanted)?;
        let without = match options.without {
            None => wgpu::Features::empty(),
            Some(Optional::EarlyDepth) => wgpu::Features::SHADER_EARLY_DEPTH_TEST,
            Some(Optional::IndirectDraws) => wgpu::Features::INDIRECT_FIRST_INSTANCE,
        };
        let optional = OPTIONAL - without;
        let (device, queue) = open_device(&adapter, optional)?;

        let faults = Arc::new(Faults::default());
        let seen = Arc::clone(&faults);
        device.on_uncaptured_error(Arc::new(move |error| note(&seen.refused, error.to_string())));
        let seen = Arc::clone(&faults);
        device.set_device_lost_callback(move |_, reason| note(&seen.lost, reason));

        let indirect = device.features().contains(wgpu::Features::INDIRECT_FIRST_INSTANCE)
            && adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::INDIRECT_EXECUTION);
        let early_depth = device.features().contains(wgpu::Features::SHADER_EARLY_DEPTH_TEST);
        Ok(Arc::new(Self { instance, adapter, device, queue, indirect, early_depth, submitting: RwLock::new(()), faults }))
    }

    /// Whether it can test boxes: draws must take their counts from buffers, fragment shaders must write, and OpenGL's cannot read depth.
    pub(super) fn can_cull(&self) -> bool {
        let can = self.adapter.get_downlevel_capabilities().flags;
        let writes = can.contains(wgpu::DownlevelFlags::FRAGMENT_WRITABLE_STORAGE);
        self.indirect && writes && self.adapter.get_info().backend != wgpu::Backend::Gl
    }

    /// The GPU, its interface and its driver, as `llvmpipe (LLVM 15.0.6, 256 bits), Vulkan, Mesa 22.3.6`.
    pub fn describe(&self) -> String {
        let info = self.adapter.get_info();
        format!(
            "{}, {:?}, {}",
            info.name,
            info.backend,
            if info.driver_info.is_empty() { &info.driver } else { &info.driver_info }
        )
    }

    /// Hands work to the GPU.
    pub(super) fn submit(&self, commands: Option<wgpu::CommandBuffer>) -> wgpu::SubmissionIndex {
        let _submitting = self.submitting.read().unwrap_or_else(PoisonError::into_inner);
        self.queue.submit(commands)
    }

    /// Gives a surface its size and format.
    pub(super) fn configure(&self, surface: &wgpu::Surface<'_>, config: &wgpu::SurfaceConfiguration) {
        let _alone = self.submitting.write().unwrap_or_else(PoisonError::into_inner);
        surface.configure(&self.device, config);
    }

    /// The error that was reported since the last call, if any. A lost GPU stays lost.
    pub(super) fn check(&self) -> Result<(), GpuError> {
        if let Some(reason) = self.faults.lost.lock().unwrap_or_else(PoisonError::into_inner).clone() {
            return Err(GpuError::Lost(reason));
        }
        match self.faults.refused.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(reason) => Err(GpuError::Refused(reason)),
            None => Ok(()),
        }
    }

    /// Learns what the GPU has done by now, and does not wait.
    pub(super) fn poll(&self) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::Poll);
        self.check()?;
        polled.map(|_| ()).map_err(|e| GpuError::Lost(e.to_string()))
    }

    /// Waits until the GPU has done all work submitted up to `submission`, or at all.
    pub(super) fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        let waited = self.device.poll(wgpu::PollType::Wait { submission_index: submission, timeout: None });
        self.check()?;
        waited.map(|_| ()).map_err(|e| GpuError::Lost(e.to_string()))
    }
}

/// Keeps the first report: what follows is often its consequence.
fn note(place: &Mutex<Option<String>>, report: String) {
    tracing::error!(report, "GPU");
    place.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(report);
}

fn choose(adapters: Vec<wgpu::Adapter>, wanted: Option<String>) -> Result<wgpu::Adapter, GpuError> {
    let names = || adapters.iter().map(|a| a.get_info().name).collect::<Vec<_>>().join(", ");
    let named = |adapter: &wgpu::Adapter| match &wanted {
        Some(part) => adapter.get_info().name.to_lowercase().contains(&part.to_lowercase()),
        None => true,
    };
    let best = adapters.iter().filter(|a| named(a)).min_by_key(|a| rank(&a.get_info()));
    match (best, wanted.clone()) {
        (Some(best), _) => Ok(best.clone()),
        (None, Some(wanted)) if !adapters.is_empty() => Err(GpuError::NotNamed { wanted, found: names() }),
        (None, _) => Err(GpuError::NoAdapter),
    }
}

/// Least is best.
fn rank(info: &wgpu::AdapterInfo) -> (u8, u8) {
    let device = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    };
    (device, u8::from(info.backend == wgpu::Backend::Gl))
}

/// What is made use of where a GPU has it.
const OPTIONAL: wgpu::Features =
    wgpu::Features::INDIRECT_FIRST_INSTANCE.union(wgpu::Features::SHADER_EARLY_DEPTH_TEST).union(wgpu::Features::TIMESTAMP_QUERY);

fn open_device(adapter: &wgpu::Adapter, optional: wgpu::Features) -> Result<(wgpu::Device, wgpu::Queue), GpuError> {
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("mullion"),
        required_features: adapter.features() & optional,
        required_limits: adapter.limits(),
        ..Default::default()
    };
    pollster::block_on(adapter.request_device(&descriptor))
        .map_err(|e| GpuError::Open { adapter: adapter.get_info().name, reason: e.to_string() })
}
