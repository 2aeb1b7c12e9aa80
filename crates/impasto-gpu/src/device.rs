//! An open graphics card: what fails on it is an [`Error`], never a panic.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use wgpu::{Buffer, BufferUsages, CommandEncoder, ErrorFilter, PollType};

use crate::adapter::{Adapter, Choice, chosen};
use crate::error::{Error, Result};
use crate::pipeline::{self, Kernel};

/// An open graphics card. Copies share it, with its compiled kernels.
#[derive(Clone, Debug)]
pub struct Gpu {
    open: Arc<Open>,
    largest_binding: u64,
}

#[derive(Debug)]
struct Open {
    adapter: Adapter,
    device: wgpu::Device,
    queue: wgpu::Queue,
    /// What the driver said when it gave up, or without being asked.
    failure: Arc<Mutex<Option<Error>>>,
    kernels: Mutex<HashMap<Kernel, Arc<wgpu::ComputePipeline>>>,
    modules: pipeline::Modules,
}

impl Gpu {
    /// Opens a card.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] if there is none, or the driver's message.
    pub fn open(choice: Choice<'_>) -> Result<Self> {
        let (adapter, handle) = chosen(choice)?;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("impasto"),
            required_limits: handle.limits(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let name = adapter.name.clone();
        let (device, queue) = pollster::block_on(handle.request_device(&descriptor))
            .map_err(|error| Error::Driver { adapter: name.clone(), problem: error.to_string() })?;
        let failure = Arc::new(Mutex::new(None));
        let (unasked, lost) = (Arc::clone(&failure), Arc::clone(&failure));
        let card = name.clone();
        device.on_uncaptured_error(Arc::new(move |error| {
            note(&unasked, Error::of(&card, &error));
        }));
        device.set_device_lost_callback(move |reason, message| {
            let problem = if message.is_empty() { format!("{reason:?}") } else { message };
            note(&lost, Error::DeviceLost { adapter: name.clone(), problem });
        });
        let modules = pipeline::Modules::new(&device);
        let largest_binding =
            device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        let kernels = Mutex::new(HashMap::new());
        let open = Arc::new(Open { adapter, device, queue, failure, kernels, modules });
        Ok(Self { open, largest_binding })
    }

    /// The same card, with arrays of at most so many bytes: larger paintings are rendered in bands.
    #[must_use]
    pub fn limited_to(&self, bytes: u64) -> Self {
        Self { open: Arc::clone(&self.open), largest_binding: self.largest_binding.min(bytes) }
    }

    /// Which card this is.
    #[must_use]
    pub fn adapter(&self) -> &Adapter {
        &self.open.adapter
    }

    /// Gives the card back to the driver: every later call fails with [`Error::DeviceLost`], as
    /// it does if the driver itself gives up.
    pub fn close(&self) {
        self.open.device.destroy();
        let _ = self.open.device.poll(PollType::Poll);
        let problem = "it was closed".to_owned();
        note(
            &self.open.failure,
            Error::DeviceLost { adapter: self.adapter().name.clone(), problem },
        );
    }

    /// Bytes of the largest array that a kernel may read or write.
    pub(crate) fn largest_binding(&self) -> u64 {
        self.largest_binding
    }

    /// Whether nothing has failed so far that makes the card useless.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.usable().is_ok()
    }

    /// Why the card is of no use any more, if it is not.
    pub(crate) fn usable(&self) -> Result<()> {
        locked(&self.open.failure).clone().map_or(Ok(()), Err)
    }

    /// Carries out `work`; what the driver complains of meanwhile is an error.
    pub(crate) fn checked<T>(&self, work: impl FnOnce(&Self) -> T) -> Result<T> {
        self.usable()?;
        let filters = [ErrorFilter::Internal, ErrorFilter::Validation, ErrorFilter::OutOfMemory];
        let scopes = filters.map(|filter| self.open.device.push_error_scope(filter));
        let answer = work(self);
        let mut problem = None;
        // The last one pushed comes first.
        for scope in scopes.into_iter().rev() {
            problem = problem.or(pollster::block_on(scope.pop()));
        }
        self.usable()?;
        match problem {
            None => Ok(answer),
            Some(error) => Err(Error::of(&self.adapter().name, &error)),
        }
    }

    pub(crate) fn buffer(&self, bytes: u64, usage: BufferUsages) -> Buffer {
        self.open.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            // An empty array cannot be bound.
            size: bytes.max(16).next_multiple_of(16),
            usage,
            mapped_at_creation: false,
        })
    }

    /// A buffer that holds these values.
    pub(crate) fn filled<T: bytemuck::NoUninit>(
        &self,
        values: &[T],
        usage: BufferUsages,
    ) -> Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let buffer = self.buffer(bytes.len() as u64, usage | BufferUsages::COPY_DST);
        self.write(&buffer, 0, values);
        buffer
    }

    /// Writes values at a number of values from the start of a buffer.
    pub(crate) fn write<T: bytemuck::NoUninit>(&self, buffer: &Buffer, place: usize, values: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        if !bytes.is_empty() {
            self.open.queue.write_buffer(buffer, (place * size_of::<T>()) as u64, bytes);
        }
    }

    /// The compiled kernel, made the first time that it is asked for.
    pub(crate) fn kernel(&self, kernel: Kernel) -> Arc<wgpu::ComputePipeline> {
        let mut kernels = locked(&self.open.kernels);
        let made = || Arc::new(self.open.modules.pipeline(&self.open.device, kernel));
        Arc::clone(kernels.entry(kernel).or_insert_with(made))
    }

    pub(crate) fn bind_group(&self, kernel: Kernel, buffers: &[&Buffer]) -> wgpu::BindGroup {
        let entries: Vec<_> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        self.open.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: self.open.modules.layout(kernel),
            entries: &entries,
        })
    }

    pub(crate) fn encoder(&self) -> CommandEncoder {
        self.open.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    pub(crate) fn submit(&self, encoder: CommandEncoder) {
        self.open.queue.submit([encoder.finish()]);
    }

    /// Waits until what was written is on the card: until then the CPU holds a copy of it.
    pub(crate) fn flush(&self) {
        self.open.queue.submit([]);
        // A card that fails here fails the next time it is used.
        let _ = self.open.device.poll(PollType::wait_indefinitely());
    }

    /// Waits for what was submitted, and gives a buffer's first `bytes` to `read`.
    pub(crate) fn read(&self, buffer: &Buffer, bytes: u64, read: impl FnOnce(&[u8])) -> Result<()> {
        let failed =
            |problem: String| Error::Driver { adapter: self.adapter().name.clone(), problem };
        let (sender, receiver) = std::sync::mpsc::channel();
        let slice = buffer.slice(..bytes);
        slice.map_async(wgpu::MapMode::Read, move |outcome| {
            // Nobody listening only means that the caller has given up.
            let _ = sender.send(outcome);
        });
        let polled = self.open.device.poll(PollType::wait_indefinitely());
        self.usable()?;
        polled.map_err(|error| failed(error.to_string()))?;
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(failed(error.to_string())),
            Err(error) => return Err(failed(error.to_string())),
        }
        {
            let view = slice.get_mapped_range().map_err(|error| failed(error.to_string()))?;
            read(&view);
        }
        buffer.unmap();
        Ok(())
    }
}

/// Keeps the first failure; a loss is the reason for all others.
fn note(failure: &Mutex<Option<Error>>, error: Error) {
    let mut kept = locked(failure);
    if kept.is_none() || matches!(error, Error::DeviceLost { .. }) {
        *kept = Some(error);
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
