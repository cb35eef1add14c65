//! From paths and overrides to a [`Setup`], or to everything that is wrong.

use super::agree::{self, PlanReading, RigReading, SensorReading};
use super::check_report::CheckReport;
use super::document::{Document, Reading, Setting};
use super::lookup::{Kind, Lookup, NotFound, SourceFile, by_path};
use super::protocol_file;
use super::report::{COMMAND_LINE, ConfigError, Finding};
use super::rig::{ANY_SENSOR, RigConfig, RigFile};
use super::sensor::{SensorConfig, SensorFile};
use super::tree::Origin;
use super::unused;
use crate::cache::{self, Store};
use crate::device::camera::settings::CameraSource;
use crate::indenter::spec::Shape;
use crate::indenter::{self, Indenter, IndenterSpec};
use crate::motion::Trajectory;
use crate::plan::estimate::{Pace, estimate};
use crate::plan::{Estimate, Plan, PlanFile};
use crate::protocol::{Pattern, Spec};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Everything that a run needs to know, resolved and checked.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The bench. The size of a virtual camera's picture is the sensor's.
    pub rig: RigConfig,
    /// Protocols of the rig's devices, by the name the rig file uses.
    pub protocols: BTreeMap<String, Arc<Spec>>,
    /// The sensor: the plan's, or the one the rig carries; `None` on a virtual bench without a plan.
    pub sensor: Option<SensorConfig>,
    /// What to do, if a plan was given.
    pub plan: Option<PlanSetup>,
    /// Every file that was read, word for word, rig first.
    pub sources: Vec<SourceFile>,
    /// The overrides, as they were given.
    pub sets: Vec<String>,
    /// What passes, though whoever wrote it may expect more of it.
    pub warnings: Vec<String>,
}

/// A plan that may be performed on the rig.
#[derive(Debug, Clone)]
pub struct PlanSetup {
    /// The plan.
    pub plan: Plan,
    /// Its expansion.
    pub trajectory: Trajectory,
    /// Its indenters by name.
    pub indenters: BTreeMap<String, IndenterConfig>,
    /// Time and disk.
    pub estimate: Estimate,
}

/// An indenter of the plan.
#[derive(Debug, Clone)]
pub struct IndenterConfig {
    /// Radius with which its edges are rounded, mm: the plan's, or else its file's.
    pub edge_round_mm: f64,
    /// The body.
    pub body: Arc<dyn Indenter>,
}

impl PlanSetup {
    /// The indenters' bodies by name.
    pub fn bodies(&self) -> BTreeMap<String, Arc<dyn Indenter>> {
        self.indenters.iter().map(|(name, i)| (name.clone(), i.body.clone())).collect()
    }
}

impl Setup {
    /// The rig file as it was read.
    pub fn rig_source(&self) -> &SourceFile {
        &self.sources[0]
    }

    /// The first file of a kind.
    pub fn source(&self, kind: Kind) -> Option<&SourceFile> {
        self.sources.iter().find(|s| s.kind == kind)
    }

    /// BLAKE3 over all files and overrides: equal hashes mean equal configurations.
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for source in &self.sources {
            hasher.update(format!("{:?} {} {}\n", source.kind, source.name, source.blake3).as_bytes());
        }
        for set in &self.sets {
            hasher.update(format!("set {set}\n").as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }
}

/// Loads a rig, and a plan for it, with overrides.
///
/// # Errors
/// Everything that is wrong with any of the files, or with the plan on this rig.
pub fn load(rig: &Path, plan: Option<&Path>, sets: &[String]) -> Result<Setup, ConfigError> {
    let mut loader = Loader { findings: Vec::new(), sources: Vec::new() };
    let setup = loader.load(rig, plan, sets);
    match setup {
        Some(setup) if loader.findings.is_empty() => Ok(setup),
        _ => Err(ConfigError { findings: loader.findings }),
    }
}

/// What `twinrig check` shows.
///
/// # Errors
/// As [`load`].
pub fn check(rig: &Path, plan: Option<&Path>, sets: &[String]) -> Result<CheckReport, ConfigError> {
    load(rig, plan, sets).map(|setup| CheckReport::new(&setup))
}

struct Loader {
    findings: Vec<Finding>,
    sources: Vec<SourceFile>,
}

impl Loader {
    fn load(&mut self, rig: &Path, plan: Option<&Path>, sets: &[String]) -> Option<Setup> {
        // The two files that were given, and the overrides in them.
        let mut rig_document = self.open(Kind::Rig, rig);
        let mut plan_document = plan.and_then(|path| self.open(Kind::Plan, path));
        let lookup =
            Lookup::new(rig_document.as_ref().map(|d| &d.source), plan_document.as_ref().map(|d| &d.source));
        let sensor_sets = self.apply(sets, rig_document.as_mut(), plan.is_some(), plan_document.as_mut());

        let rig_read =
            rig_document.as_ref().and_then(|d| d.read(|file: &RigFile, p| file.check(p), &mut self.findings));
        let warnings = match (&rig_document, &rig_read) {
            (Some(document), Some(rig)) => unused::look(document, rig, &mut self.findings),
            _ => Vec::new(),
        };
        let plan_read = plan_document
            .as_ref()
            .and_then(|d| d.read(|file: &PlanFile, p| file.check(p), &mut self.findings));

        // The files that they name, as far as the names can be made out.
        let protocols = match (&rig_document, &rig_read) {
            (Some(document), Some(rig)) => self.protocols(document, rig, &lookup),
            _ => BTreeMap::new(),
        };
        let sensor_file = self.sensor(rig_document.as_ref(), plan_document.as_ref(), &lookup, &sensor_sets);
        let indenters = match (&plan_document, &plan_read) {
            (Some(document), Some(plan)) => self.indenters(document, plan, &lookup),
            _ => BTreeMap::new(),
        };

        // All of them together, as far as each holds.
        if let (Some(document), Some(rig), Some((sensor_document, sensor))) =
            (&rig_document, &rig_read, &sensor_file)
        {
            agree::on_picture(document, rig, sensor, &mut self.findings);
            agree::on_elastomer((document, rig), (sensor_document, sensor), &mut self.findings);
        }
        let sensor_read = sensor_file.map(|(_, sensor)| sensor);
        let plan_on_rig = match (&plan_document, &plan_read, &rig_read) {
            (Some(document), Some(plan), Some(rig)) => {
                agree::on_path(document, plan, rig, sensor_read.as_ref(), &indenters, &mut self.findings)
            }
            _ => None,
        };
        if let (Some(document), Some(trajectory), Some(sensor)) = (&plan_document, &plan_on_rig, &sensor_read)
        {
            agree::on_clear_bodies(document, trajectory, sensor, &mut self.findings);
        }
        if !self.findings.is_empty() {
            return None;
        }

        let mut rig = rig_read?.into_sound()?;
        let sensor = sensor_read.and_then(Reading::into_sound);
        if let Some(sensor) = sensor.as_ref().filter(|_| rig.camera.source == CameraSource::Virtual) {
            // A virtual camera takes the sensor's raster.
            [rig.camera.width, rig.camera.height] = agree::raster(sensor);
        }
        let plan =
            plan_read.and_then(Reading::into_sound).flatten().zip(plan_on_rig).map(|(plan, trajectory)| {
                let estimate = estimate(&plan, &trajectory, &rig.fences(), &pace(&rig));
                PlanSetup { plan, trajectory, indenters, estimate }
            });
        Some(Setup {
            rig,
            protocols,
            sensor,
            plan,
            sources: std::mem::take(&mut self.sources),
            sets: sets.to_vec(),
            warnings,
        })
    }

    fn open(&mut self, kind: Kind, path: &Path) -> Option<Document> {
        match by_path(kind, path) {
            Ok(source) => {
                self.sources.push(source.clone());
                Document::parse(source, &mut self.findings)
            }
            Err(NotFound { asked, allowed, next }) => {
                let file = path.display().to_string();
                self.findings.push(Finding {
                    file,
                    at: None,
                    key: String::new(),
                    value: asked,
                    allowed,
                    next,
                });
                None
            }
        }
    }

    /// Sorts the overrides by file. Those of the sensor are returned, since the sensor is not known yet.
    fn apply(
        &mut self,
        sets: &[String],
        mut rig: Option<&mut Document>,
        has_plan: bool,
        mut plan: Option<&mut Document>,
    ) -> Vec<Setting> {
        let mut for_sensor = Vec::new();
        for text in sets {
            let setting = match Setting::parse(text) {
                Ok(setting) => setting,
                Err(finding) => {
                    self.findings.push(*finding);
                    continue;
                }
            };
            let inner = setting.within_domain();
            let (document, key) = match setting.domain() {
                "sensor" if !inner.0.is_empty() => {
                    for_sensor.push(setting);
                    continue;
                }
                "plan" if !has_plan => {
                    self.findings.push(Finding {
                        file: COMMAND_LINE.to_owned(),
                        at: Some(Origin::Set(text.clone())),
                        key: setting.key.to_string(),
                        value: "there is no plan".to_owned(),
                        allowed: "keys of the rig, or of a plan that is given".to_owned(),
                        next: "give a plan file".to_owned(),
                    });
                    continue;
                }
                "plan" => (plan.as_deref_mut(), inner),
                _ => (rig.as_deref_mut(), setting.key.clone()),
            };
            if let Some(document) = document {
                document.set(text, &key, setting.value.clone(), &mut self.findings);
            }
        }
        for_sensor
    }

    fn protocols(
        &mut self,
        document: &Document,
        rig: &RigReading,
        lookup: &Lookup,
    ) -> BTreeMap<String, Arc<Spec>> {
        let mut protocols: BTreeMap<String, Arc<Spec>> = BTreeMap::new();
        for (device, mover) in &rig.value.devices {
            let key = format!("devices.{device}.protocol");
            if !rig.holds(&key) {
                continue;
            }
            if let Some(spec) = protocols.get(&mover.protocol) {
                self.wiring(document, device, rig, spec);
                continue;
            }
            let Some(source) = self.named(Kind::Protocol, &mover.protocol, document, &key, lookup) else {
                continue;
            };
            if let Some(file) = protocol_file::read(source, &mut self.findings) {
                self.wiring(document, device, rig, &file.spec);
                protocols.insert(mover.protocol.clone(), file.spec);
            }
        }
        protocols
    }

    /// What the protocol wants of the device's table.
    fn wiring(&mut self, document: &Document, device: &str, rig: &RigReading, spec: &Spec) {
        let mover = &rig.value.devices[device];
        for (name, axis) in &mover.axes {
            let key = |key: &str| format!("devices.{device}.axes.{name}.{key}");
            if rig.holds(&key("wire")) && !spec.axis.wire.is_match(axis.wire.as_bytes()) {
                self.findings.push(document.complain(
                    &key("wire"),
                    format!("{:?}", axis.wire),
                    format!("a name that {} gives its axes: {}", mover.protocol, spec.axis.wire.as_str()),
                    "write the letter or address that this axis has on the controller",
                ));
            }
            if rig.holds(&key("counts_per_unit")) && spec.axis.counts && axis.counts_per_unit.is_none() {
                self.findings.push(document.complain(
                    &key("counts_per_unit"),
                    "missing",
                    "device counts per mm or degree",
                    format!("add it: {} speaks in counts", mover.protocol),
                ));
            }
        }
        if let Some(Err(error)) = mover.identity.as_deref().map(Pattern::new) {
            self.findings.push(document.complain(
                &format!("devices.{device}.identity"),
                format!("{:?}", mover.identity.as_deref().unwrap_or_default()),
                format!("a regular expression ({})", error.lines().last().unwrap_or_default().trim()),
                "write a part of what the firmware says about itself, e.g. \"Marlin\"",
            ));
        }
    }

    /// The file of that name, or a finding at the key that names it.
    fn named(
        &mut self,
        kind: Kind,
        name: &str,
        document: &Document,
        key: &str,
        lookup: &Lookup,
    ) -> Option<SourceFile> {
        match lookup.find(kind, name) {
            Ok(source) => {
                self.sources.push(source.clone());
                Some(source)
            }
            Err(NotFound { asked, allowed, next }) => {
                self.findings.push(document.complain(key, asked, allowed, next));
                None
            }
        }
    }

    fn sensor(
        &mut self,
        rig: Option<&Document>,
        plan: Option<&Document>,
        lookup: &Lookup,
        sets: &[Setting],
    ) -> Option<(Document, SensorReading)> {
        // Asked of the trees, so that a mistake elsewhere in those files does not hide one here.
        let named = |document: Option<&Document>| {
            let document = document?;
            Some((document.clone(), document.text_at("sensor")?.to_owned()))
        };
        let carried = named(rig).filter(|(_, name)| name != ANY_SENSOR);
        let wanted = named(plan);
        if let (Some((document, name)), Some(_)) = (&carried, &wanted)
            && lookup.find(Kind::Sensor, name).is_err()
        {
            self.named(Kind::Sensor, name, document, "sensor", lookup);
            return None;
        }
        if let (Some((_, carried)), Some((document, wanted))) = (&carried, &wanted)
            && carried != wanted
        {
            self.findings.push(document.complain(
                "sensor",
                format!("{wanted:?}"),
                format!("\"{carried}\", which this rig carries"),
                "choose a plan for this sensor, or mount the other one and say so in the rig file",
            ));
        }
        let Some((naming, name)) = wanted.or(carried) else {
            let is_certain = rig.is_some() && plan.is_none();
            self.findings.extend(sets.iter().filter(|_| is_certain).map(|setting| Finding {
                file: COMMAND_LINE.to_owned(),
                at: Some(Origin::Set(setting.text.clone())),
                key: setting.key.to_string(),
                value: "there is no sensor".to_owned(),
                allowed: "keys of a sensor that the plan or the rig names".to_owned(),
                next: "give a plan file".to_owned(),
            }));
            return None;
        };
        let source = self.named(Kind::Sensor, &name, &naming, "sensor", lookup)?;
        let (stem, folder) = (source.name.clone(), source.folder.clone());
        let mut document = Document::parse(source, &mut self.findings)?;
        for setting in sets {
            document.set(&setting.text, &setting.within_domain(), setting.value.clone(), &mut self.findings);
        }
        let sensor = document
            .read(|file: &SensorFile, p| file.check(Some(&stem), folder.as_deref(), p), &mut self.findings)?;
        Some((document, sensor))
    }

    fn indenters(
        &mut self,
        plan_document: &Document,
        plan: &PlanReading,
        lookup: &Lookup,
    ) -> BTreeMap<String, IndenterConfig> {
        let mut indenters = BTreeMap::new();
        let meshes = cache::folder().map(|f| Store::new(f.join("indenters"), &indenter::stl::kept::KIND));
        for (i, planned) in plan.value.indenters.iter().enumerate() {
            let key = format!("indenters[{i}]");
            let name_key = format!("{key}.name");
            let name = &planned.name;
            if !plan.holds(&name_key) {
                continue;
            }
            let Some(source) = self.named(Kind::Indenter, name, plan_document, &name_key, lookup) else {
                continue;
            };
            let folder = source.folder.clone();
            let Some(document) = Document::parse(source, &mut self.findings) else { continue };
            let read = document.read(|spec: &IndenterSpec, p| spec.check(p), &mut self.findings);
            let Some(mut spec) = read.filter(Reading::is_sound).map(|r| r.value) else { continue };
            if !plan.holds(&format!("{key}.edge_round_mm")) {
                continue;
            }
            if let (Shape::Stl { path, .. }, Some(folder)) = (&mut spec.shape, folder) {
                *path = folder.join(&path);
            }
            let edge_round_mm = planned.edge_round_mm.unwrap_or(spec.edge_round_mm);
            match indenter::from_spec_or_store(name, &spec, planned.edge_round_mm, meshes.as_ref()) {
                Ok(body) => {
                    indenters.insert(name.clone(), IndenterConfig { edge_round_mm, body });
                }
                Err(error) => self.findings.push(plan_document.finding(&error.problem(&key))),
            }
        }
        indenters
    }
}

/// Serial round trips of one move: the command's reply, the barrier's, a position.
const COMMAND: Duration = Duration::from_millis(60);

/// Frame rate where the rig file leaves it to the camera.
const USUAL_FPS: f64 = 30.0;

fn pace(rig: &RigConfig) -> Pace {
    let settle = rig.devices.values().map(|d| d.settle_ms).max().unwrap_or(0);
    let frame = Duration::from_secs_f64(1.0 / rig.camera.fps.unwrap_or(USUAL_FPS));
    // The frame in progress is too old; then one that must agree with the next.
    let frames = 2 + u32::from(rig.camera.mean_of);
    Pace {
        settle: Duration::from_millis(settle),
        exposure: frame * frames,
        command: COMMAND,
        pixels: u64::from(rig.camera.width) * u64::from(rig.camera.height),
    }
}
