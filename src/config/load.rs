//! From paths and overrides to a [`Setup`], or to everything that is wrong.

use super::check_report::CheckReport;
use super::document::{Document, Setting};
use super::lookup::{Kind, Lookup, NotFound, SourceFile, by_path};
use super::protocol_file;
use super::report::{COMMAND_LINE, ConfigError, Finding};
use super::rig::{ANY_SENSOR, RigConfig, RigFile};
use super::sensor::{SensorConfig, SensorFile};
use super::tree::Origin;
use crate::device::camera::settings::CameraSource;
use crate::device::settings::MoverSettings;
use crate::elastomer;
use crate::indenter::spec::Shape;
use crate::indenter::{self, Indenter, IndenterSpec};
use crate::motion::Trajectory;
use crate::plan::estimate::{Pace, estimate};
use crate::plan::{self, Estimate, Plan, PlanFile};
use crate::problem::{Problem, Problems};
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

        let rig = rig_document.as_ref().and_then(|d| {
            d.read(|file: &RigFile, p| file.check(p), &mut self.findings).map(|(_, checked)| checked)
        });
        let plan_read = plan_document.as_ref().and_then(|d| {
            let read = d.read(|file: &PlanFile, p| file.check(p), &mut self.findings);
            read.and_then(|(_, checked)| checked)
        });

        // The files that they name.
        let protocols = match (&rig_document, &rig) {
            (Some(document), Some(rig)) => self.protocols(document, rig, &lookup),
            _ => BTreeMap::new(),
        };
        let sensor = self.sensor(rig_document.as_ref(), plan_document.as_ref(), &lookup, &sensor_sets);
        let indenters = match (&plan_document, &plan_read) {
            (Some(document), Some(plan)) => self.indenters(document, plan, &lookup),
            _ => BTreeMap::new(),
        };
        if !self.findings.is_empty() {
            return None;
        }

        // All of them together.
        let mut rig = rig?;
        if let (Some(document), Some(sensor)) = (&rig_document, &sensor) {
            self.agree_on_picture(document, &mut rig, sensor);
            self.agree_on_elastomer(document, &rig, sensor);
        }
        let plan = match (&plan_document, plan_read, &sensor) {
            (Some(document), Some(plan), Some(sensor)) => {
                Some(self.plan_on_rig(document, plan, &rig, sensor, indenters))
            }
            _ => None,
        };
        Some(Setup {
            rig,
            protocols,
            sensor,
            plan,
            sources: std::mem::take(&mut self.sources),
            sets: sets.to_vec(),
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
        rig: &RigConfig,
        lookup: &Lookup,
    ) -> BTreeMap<String, Arc<Spec>> {
        let mut protocols: BTreeMap<String, Arc<Spec>> = BTreeMap::new();
        for (device, mover) in &rig.devices {
            if let Some(spec) = protocols.get(&mover.protocol) {
                self.wiring(document, device, mover, spec);
                continue;
            }
            let key = format!("devices.{device}.protocol");
            let Some(source) = self.named(Kind::Protocol, &mover.protocol, document, &key, lookup) else {
                continue;
            };
            if let Some(file) = protocol_file::read(source, &mut self.findings) {
                self.wiring(document, device, mover, &file.spec);
                protocols.insert(mover.protocol.clone(), file.spec);
            }
        }
        protocols
    }

    /// What the protocol wants of the device's table.
    fn wiring(&mut self, document: &Document, device: &str, mover: &MoverSettings, spec: &Spec) {
        for (name, axis) in &mover.axes {
            let key = |key: &str| format!("devices.{device}.axes.{name}.{key}");
            if !spec.axis.wire.is_match(axis.wire.as_bytes()) {
                self.findings.push(document.complain(
                    &key("wire"),
                    format!("{:?}", axis.wire),
                    format!("a name that {} gives its axes: {}", mover.protocol, spec.axis.wire.as_str()),
                    "write the letter or address that this axis has on the controller",
                ));
            }
            if spec.axis.counts && axis.counts_per_unit.is_none() {
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
    ) -> Option<SensorConfig> {
        // Asked of the trees, so that a mistake elsewhere in those files does not hide one here.
        let named = |document: Option<&Document>| {
            let document = document?;
            Some((document.clone(), document.text_at("sensor")?.to_owned()))
        };
        let carried = named(rig).filter(|(_, name)| name != ANY_SENSOR);
        let wanted = named(plan);
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
        let stem = source.name.clone();
        let mut document = Document::parse(source, &mut self.findings)?;
        for setting in sets {
            document.set(&setting.text, &setting.within_domain(), setting.value.clone(), &mut self.findings);
        }
        let read = document.read(|file: &SensorFile, p| file.check(&stem, p), &mut self.findings);
        read.map(|(_, checked)| checked)
    }

    fn indenters(
        &mut self,
        plan_document: &Document,
        plan: &Plan,
        lookup: &Lookup,
    ) -> BTreeMap<String, IndenterConfig> {
        let mut indenters = BTreeMap::new();
        for (i, planned) in plan.indenters.iter().enumerate() {
            let key = format!("indenters[{i}]");
            let name_key = format!("{key}.name");
            let name = &planned.name;
            let Some(source) = self.named(Kind::Indenter, name, plan_document, &name_key, lookup) else {
                continue;
            };
            let folder = source.folder.clone();
            let Some(document) = Document::parse(source, &mut self.findings) else { continue };
            let read = document.read(|spec: &IndenterSpec, p| spec.check(p), &mut self.findings);
            let Some((mut spec, ())) = read else { continue };
            if let (Shape::Stl { path, .. }, Some(folder)) = (&mut spec.shape, folder) {
                *path = folder.join(&path);
            }
            let edge_round_mm = planned.edge_round_mm.unwrap_or(spec.edge_round_mm);
            match indenter::from_spec(name, &spec, planned.edge_round_mm) {
                Ok(body) => {
                    indenters.insert(name.clone(), IndenterConfig { edge_round_mm, body });
                }
                Err(error) => self.findings.push(plan_document.complain(
                    &key,
                    name,
                    error.to_string(),
                    "correct the indenter's file, or edge_round_mm in the plan",
                )),
            }
        }
        indenters
    }

    /// A virtual camera takes the sensor's raster; a real one must already have it.
    fn agree_on_picture(&mut self, document: &Document, rig: &mut RigConfig, sensor: &SensorConfig) {
        let raster = [sensor.optics.camera.width_px, sensor.optics.camera.height_px].map(|n| n as u32);
        if rig.camera.source == CameraSource::Virtual {
            [rig.camera.width, rig.camera.height] = raster;
            return;
        }
        let given = [("camera.width", rig.camera.width), ("camera.height", rig.camera.height)];
        for ((key, given), wanted) in given.into_iter().zip(raster) {
            if given != wanted {
                self.findings.push(document.complain(
                    key,
                    given,
                    format!("{wanted} px, the raster of sensor {}", sensor.name),
                    "choose that camera mode, or correct [optics.camera] in the sensor file",
                ));
            }
        }
    }

    /// What the twin's solver will refuse is refused before anything moves.
    fn agree_on_elastomer(&mut self, document: &Document, rig: &RigConfig, sensor: &SensorConfig) {
        if let Err(elastomer::Error::Setting { key, value, why }) =
            elastomer::check(&sensor.pad, &rig.elastomer)
        {
            self.findings.push(document.complain(
                &format!("elastomer.{key}"),
                value,
                why,
                "change it in the rig file, or by --set",
            ));
        }
    }

    fn plan_on_rig(
        &mut self,
        document: &Document,
        plan: Plan,
        rig: &RigConfig,
        sensor: &SensorConfig,
        indenters: BTreeMap<String, IndenterConfig>,
    ) -> PlanSetup {
        let trajectory = plan::expand(&plan);
        let fences = rig.fences();
        let bodies = indenters.iter().map(|(name, i)| (name.clone(), i.body.clone())).collect();
        let bench = plan::check::Bench { rig: &fences, pad: &sensor.pad, indenters: &bodies };
        let mut problems = Problems::new();
        plan::check(&plan, &trajectory, &bench, &mut problems);
        let mut problems: Vec<Problem> = problems.into_vec();
        problems.sort_by(|a, b| a.key.cmp(&b.key));
        self.findings.extend(problems.iter().map(|p| document.finding(p)));
        let estimate = estimate(&plan, &trajectory, &fences, &pace(rig));
        PlanSetup { plan, trajectory, indenters, estimate }
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
