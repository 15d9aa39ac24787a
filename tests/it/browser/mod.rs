//! The report page as a user sees it, in a real Chromium. Skipped if there is none.
//!
//! The page is opened in a frame with the width and theme that a test needs. There, `visitor.js` does what a user would
//! do, and reports what is visible. Screenshots are left in `target/tmp/*.png`.

use std::path::Path;
use std::process::Command;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use sinew::internals::tables::{self, Table, Values};

use super::cli::{sinew, text};
use super::support::{SMALL, folder, root};

const VISITOR: &str = include_str!("visitor.js");
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome-stable", "google-chrome"];
/// Height of the screenshot in pixels.
const HEIGHT: u32 = 5000;

/// What to do on a page.
#[derive(Clone, Default, Serialize)]
struct Ask {
    /// Sort the jobs twice by this column.
    sort: Option<String>,
    /// Choose the job with this id, through its link.
    choose: Option<String>,
    /// Hover over each point of the first line of this figure.
    hover: Option<String>,
    /// Show maps against this axis.
    map: Option<String>,
}

/// What is visible.
#[derive(Debug, Deserialize)]
struct Seen {
    background: String,
    /// Width of the whole content, pixels.
    across: f64,
    counts: String,
    /// Text of the section with the warnings.
    warnings: String,
    failures: usize,
    /// Ids of the headings of the sections that are shown.
    sections: Vec<String>,
    ranks: usize,
    jobs: Vec<String>,
    job: String,
    muscles: Vec<Vec<String>>,
    choices: Vec<(String, String)>,
    figures: Vec<Figure>,
    #[serde(default)]
    tips: Vec<String>,
    #[serde(default)]
    sorted: Vec<Sorted>,
    #[serde(default)]
    maps: Vec<Figure>,
    #[serde(default)]
    left: Vec<String>,
    chosen: Option<Chosen>,
}

#[derive(Debug, Deserialize)]
struct Figure {
    name: String,
    shapes: usize,
    broken: bool,
}

#[derive(Debug, Deserialize)]
struct Sorted {
    order: String,
    focused: bool,
    values: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct Chosen {
    address: String,
    job: String,
    row: Option<String>,
}

/// The installed browser. Prints a message if there is none.
fn browser(test: &str) -> Option<&'static str> {
    let found = BROWSERS.into_iter().find(|name| Command::new(name).arg("--version").output().is_ok());
    if found.is_none() {
        eprintln!("SKIPPED: {test}: there is no Chromium (.ci/install gets one)");
    }
    found
}

/// Opens a page in the light or dark theme with the given width, at a fragment `link` such as `#job=…`. Fails if
/// anything is printed on the console.
fn visit(browser: &str, page: &Path, link: &str, (theme, width): (&str, u32), ask: &Ask) -> Seen {
    let folder = tempfile::tempdir().unwrap();
    let html = std::fs::read_to_string(page).unwrap();
    let hook = "<head><script>
        const wrong = [];
        addEventListener('error', (e) => wrong.push(e.message));
        addEventListener('unhandledrejection', (e) => wrong.push(String(e.reason)));
        for (const kind of ['error', 'warn']) console[kind] = (...words) => wrong.push(words.join(' '));
        </script>";
    let ask = serde_json::to_string(ask).unwrap();
    let tell = format!(
        "{VISITOR}
        visit({ask}).catch((e) => ({{ failed: e.stack }}))
          .then((seen) => parent.postMessage(JSON.stringify({{ seen, wrong }}), '*'));
        "
    );
    // The page's policy allows no other script, so add the hash of this one.
    let allowed = format!("script-src 'sha256-{}'", BASE64.encode(Sha256::digest(&tell)));
    assert!(html.contains("script-src 'sha256-"), "the page has a policy on scripts");
    let html =
        html.replacen("<head>", hook, 1).replacen("script-src", &allowed, 1) + &format!("<script>{tell}</script>");
    std::fs::write(folder.path().join("page.html"), html).unwrap();
    let frame = format!(
        "<!DOCTYPE html><html style='color-scheme: {theme}'><body style='margin: 0'>
        <iframe src='page.html{link}' style='border: 0; display: block; width: {width}px; height: {HEIGHT}px'></iframe>
        <script>addEventListener('message', (e) =>
          document.body.append('<<' + btoa(unescape(encodeURIComponent(e.data))) + '>>'))</script>
        </body></html>"
    );
    std::fs::write(folder.path().join("frame.html"), frame).unwrap();
    let name = page.file_stem().unwrap().to_str().unwrap();
    let picture = format!(
        "{}/{name}-{theme}-{width}{}.png",
        env!("CARGO_TARGET_TMPDIR"),
        if link.is_empty() { "" } else { "-job" }
    );
    let output = Command::new(browser)
        .args([
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--virtual-time-budget=20000",
            "--dump-dom",
        ])
        .args(["--enable-logging=stderr", "--disable-dev-shm-usage"])
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("--screenshot={picture}"))
        .arg(format!("--window-size={},{HEIGHT}", width.max(500)))
        .arg(format!("file://{}", folder.path().join("frame.html").display()))
        .output()
        .unwrap();
    let dom = text(&output.stdout);
    let said: Vec<String> =
        text(&output.stderr).lines().filter(|line| line.contains(":CONSOLE")).map(str::to_owned).collect();
    let told = dom.split_once("&lt;&lt;").and_then(|(_, rest)| rest.split_once("&gt;&gt;"));
    let told = told.unwrap_or_else(|| panic!("{name} tells nothing: {said:?}\n{dom}")).0;
    let told = BASE64.decode(told).unwrap();
    let told: serde_json::Value = serde_json::from_slice(&told).unwrap();
    assert_eq!(told["wrong"], serde_json::json!([]), "{name}");
    assert!(said.is_empty(), "{name}: {said:?}");
    let seen: Seen = serde_json::from_value(told["seen"].clone()).unwrap_or_else(|e| panic!("{name}: {e}: {told}"));
    for figure in seen.figures.iter().chain(&seen.maps) {
        assert!(figure.shapes > 3 && !figure.broken, "{name}: {figure:?}");
    }
    assert!(seen.across <= f64::from(width), "{name} is {} wide on a screen of {width}", seen.across);
    assert_eq!(seen.background, if theme == "dark" { "rgb(22, 24, 28)" } else { "rgb(255, 255, 255)" }, "{name}");
    seen
}

/// Opens a page in both themes, on a wide screen and a phone, does what is asked, and compares what is visible with the
/// Parquet files.
fn look(browser: &str, page: &Path, dir: &Path, ask: &Ask) -> Seen {
    let (jobs, muscles) = (read(dir, "jobs"), read(dir, "muscles"));
    let chosen = jobs.rows() / 2;
    let (id, index) = (jobs.text("job_id", chosen).unwrap(), jobs.integer("index", chosen).unwrap());
    for (theme, width) in [("dark", 1280), ("light", 400), ("dark", 400)] {
        visit(browser, page, "", (theme, width), &Ask::default());
    }
    let ask = Ask { choose: Some(id.to_owned()), ..ask.clone() };
    let seen = visit(browser, page, "", ("light", 1280), &ask);

    let column = ask.sort.as_deref().unwrap();
    let mut wanted: Vec<f64> = (0..jobs.rows()).filter_map(|row| jobs.number(column, row)).collect();
    wanted.sort_by(f64::total_cmp);
    for (sorted, order) in seen.sorted.iter().zip(["ascending", "descending"]) {
        let shown: Vec<f64> = sorted.values.iter().map(|value| value.parse().unwrap()).collect();
        assert!(sorted.order == order && sorted.focused, "{sorted:?}");
        assert_eq!(shown, wanted[..shown.len()], "{column} {order}");
        wanted.reverse();
    }
    assert_eq!(seen.sorted.len(), 2);

    assert_eq!(seen.left, [index.to_string()], "the filter leaves the job that was asked for");
    let found = seen.chosen.as_ref().unwrap();
    assert_eq!((found.address.as_str(), found.job.as_str()), (&*format!("#job={id}"), &*format!("Job {index}")));
    assert_eq!(found.row.as_deref(), Some(id));
    let linked = visit(browser, page, &format!("#job={id}"), ("light", 1280), &Ask::default());
    assert_eq!(linked.job, format!("Job {index}"));
    let rows: Vec<usize> = (0..muscles.rows()).filter(|&row| muscles.text("job_id", row) == Some(id)).collect();
    assert_eq!(linked.muscles.len(), rows.len());
    for (shown, &row) in linked.muscles.iter().zip(&rows) {
        let columns = muscles.columns.iter().filter(|(name, _)| name != "job_id");
        for ((name, values), cell) in columns.zip(shown) {
            match values {
                Values::Number(v) => assert_eq!(cell.parse().ok(), v[row], "{name} {row}: {cell}"),
                Values::Integer(v) => assert_eq!(cell.parse().ok(), v[row], "{name} {row}: {cell}"),
                Values::Text(v) => assert_eq!(Some(cell), v[row].as_ref(), "{name} {row}"),
                Values::Flag(v) => assert_eq!(cell.parse().ok(), v[row], "{name} {row}: {cell}"),
            }
        }
    }
    seen
}

fn read(dir: &Path, name: &'static str) -> Table {
    tables::read(name, &dir.join(format!("{name}.parquet"))).unwrap()
}

fn report(dir: &Path, page: &Path) {
    let made = sinew(&["report", dir.to_str().unwrap(), "--out", page.to_str().unwrap()], dir);
    assert_eq!(made.status.code(), Some(0), "{}", text(&made.stderr));
}

fn has(figures: &[Figure], names: &[&str]) {
    for name in names {
        assert!(figures.iter().any(|figure| figure.name == *name), "{name}: {figures:?}");
    }
}

#[test]
fn table_1_is_there_to_look_at() {
    let Some(browser) = browser("table_1_is_there_to_look_at") else { return };
    let folder = folder(&[]);
    let study = root().join("studies/table1.toml");
    sinew(&["run", study.to_str().unwrap(), "--out", "out"], folder.path());
    let (out, page) = (folder.path().join("out"), folder.path().join("table1.html"));
    report(&out, &page);
    let seen = look(browser, &page, &out, &Ask { sort: Some("objective".to_owned()), ..Ask::default() });
    assert_eq!(seen.ranks, 24, "12 cells for each h");
    has(&seen.figures, &["mean_force_n-over-h-All_muscles", "Active_force_length", "Force_velocity", "Tendon"]);
    has(&seen.figures, &["convergence", "singular_values", "activation", "excitation", "force_n", "fibre_length"]);
    has(&seen.figures, &["fibre_velocity", "reaction_n", "joint_coordinate", "coordinate", "active_bounds"]);
    has(&seen.figures, &["stick_figure_side"]);
}

#[test]
fn a_part_of_a_thousand_jobs_is_there_to_look_at() {
    let Some(browser) = browser("a_part_of_a_thousand_jobs_is_there_to_look_at") else { return };
    let folder = folder(&[]);
    let study = root().join("studies/mu_sweep.toml");
    sinew(&["run", study.to_str().unwrap(), "--out", "out", "--shard", "3/50"], folder.path());
    sinew(&["merge", "out"], folder.path());
    let (out, page) = (folder.path().join("out"), folder.path().join("mu_sweep.html"));
    report(&out, &page);
    let figure = "mean_force_n-over-mu-All_muscles";
    let ask = Ask { sort: Some("effort".to_owned()), hover: Some(figure.to_owned()), ..Ask::default() };
    let seen = look(browser, &page, &out, &ask);
    assert!(seen.counts.starts_with("20 of 1000 jobs finished: 20 converged"), "{}", seen.counts);
    let said = &seen.warnings;
    assert!(said.contains("jobs with warnings") && said.contains("fibre_length (") && said.contains("does not fit"));
    has(&seen.figures, &[figure, "ratio-over-mu-biceps_to_brachialis_mean_force", "convergence", "singular_values"]);

    // The tooltips of the points of the first muscle equal the values in the files.
    let (jobs, muscles) = (read(&out, "jobs"), read(&out, "muscles"));
    let (_, h) = seen.choices.iter().find(|(label, _)| label == "h, s").unwrap();
    let muscle = muscles.text("muscle", 0).unwrap();
    let mut wanted: Vec<[f64; 2]> = (0..muscles.rows())
        .filter(|&row| muscles.text("muscle", row) == Some(muscle))
        .filter_map(|row| {
            let same = |job: &usize| jobs.text("job_id", *job) == muscles.text("job_id", row);
            let job = (0..jobs.rows()).find(same).unwrap();
            let number = |name| jobs.number(name, job).unwrap();
            (number("h").to_string() == *h).then(|| [number("mu"), muscles.number("mean_force_n", row).unwrap()])
        })
        .collect();
    wanted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let shown: Vec<[f64; 2]> = (seen.tips.iter())
        .map(|tip| {
            assert!(tip.starts_with(muscle), "{tip}");
            let numbers: Vec<f64> = tip.lines().filter_map(|line| line.rsplit_once(": ")?.1.parse().ok()).collect();
            [numbers[0], numbers[1]]
        })
        .collect();
    assert!(wanted.len() > 3);
    assert_eq!(shown, wanted);
}

#[test]
fn names_are_text_wherever_they_appear() {
    const EVIL: &str = "\"><img src=x onerror=alert(1)>";
    let Some(browser) = browser("names_are_text_wherever_they_appear") else { return };
    let arm = std::fs::read_to_string(root().join("data/models/arm.toml")).unwrap();
    let name = toml::Value::from(EVIL).to_string();
    let study = format!(
        "name = 'evil'\ndescription = {name}\nmodel = 'arm.toml'\nmotion = '{{root}}/data/motions/arm_curl.csv'
         [base]\nh = 0.2\ntrajectories = true\n[sweep.grid]
         'muscle.{EVIL}.max_isometric_force_scale' = [0.9, 1.0]
         [[ratio]]\nname = {name}\nnumerator = {name}\ndenominator = 'triceps'\n"
    );
    // Rename the first muscle, whose line the test hovers over.
    let folder = folder(&[("arm.toml", &arm.replace("\"deltoid_anterior\"", &name)), ("study.toml", &study)]);
    let run = sinew(&["run", "study.toml", "--out", "out"], folder.path());
    assert!(run.status.success(), "{}", text(&run.stderr));
    let (out, page) = (folder.path().join("out"), folder.path().join("evil.html"));
    report(&out, &page);
    let ask = Ask {
        sort: Some("objective".to_owned()),
        hover: Some(
            "mean_force_n-over-muscle._img_src_x_onerror_alert_1_.max_isometric_force_scale-All_muscles".to_owned(),
        ),
        ..Ask::default()
    };
    let seen = look(browser, &page, &out, &ask);
    assert!(seen.tips.len() > 1 && seen.tips.iter().all(|tip| tip.starts_with(EVIL)), "{:?}", seen.tips);
    // SVG figures are XML, and so is a test report.
    let svg = sinew(&["report", "out", "--svg"], folder.path());
    assert!(svg.status.success(), "{}", text(&svg.stderr));
    sinew(&["compare", "out", "base", "--accept"], folder.path());
    sinew(&["compare", "out", "base", "--junit", "out/figures/junit.xml"], folder.path());
    let mut files = 0;
    for entry in std::fs::read_dir(out.join("figures")).unwrap() {
        let path = entry.unwrap().path();
        roxmltree::Document::parse(&std::fs::read_to_string(&path).unwrap())
            .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        files += 1;
    }
    assert!(files > 20);
}

#[test]
fn the_abduction_study_is_there_to_look_at() {
    let Some(browser) = browser("the_abduction_study_is_there_to_look_at") else { return };
    let folder = folder(&[]);
    let (baseline, page) = (root().join("results/baselines/abduction"), folder.path().join("abduction.html"));
    report(&baseline, &page);
    let ask = Ask {
        sort: Some("objective".to_owned()),
        map: Some("body.clavicle,scapula.role".to_owned()),
        ..Ask::default()
    };
    let seen = look(browser, &page, &baseline, &ask);
    let axis = "motion.abduction_offset_deg";
    has(
        &seen.figures,
        &[
            &format!("mean_force_n-over-{axis}-TeresMajor"),
            &format!("ratio-over-{axis}-teres_major_to_latissimus_dorsi_impulse"),
        ],
    );
    has(&seen.maps, &[&format!("mean_force_n-over-{axis}-and-body.clavicle_scapula.role-TeresMajor")]);
}

#[test]
fn folders_with_failures_with_one_job_and_with_none_have_sensible_pages() {
    let Some(browser) = browser("folders_with_failures_with_one_job_and_with_none_have_sensible_pages") else { return };
    let failing = SMALL.replace("[sweep.grid]", "max_iterations = 4\n[sweep.grid]");
    let single = SMALL.split("[sweep.grid]").next().unwrap();
    for (name, study, jobs) in [("failed", failing.as_str(), 6), ("single", single, 1), ("none", SMALL, 0)] {
        let folder = folder(&[("study.toml", study)]);
        sinew(&["run", "study.toml", "--out", "out"], folder.path());
        let (out, page) = (folder.path().join("out"), folder.path().join(format!("{name}.html")));
        if jobs == 0 {
            for file in std::fs::read_dir(&out).unwrap().map(|file| file.unwrap().path()) {
                if !file.ends_with("manifest.json") {
                    std::fs::remove_file(file).unwrap();
                }
            }
        }
        report(&out, &page);
        for width in [1280, 400] {
            let seen = visit(browser, &page, "", ("light", width), &Ask::default());
            assert_eq!(seen.jobs.len(), jobs, "{name}: {}", seen.counts);
            let shows = |section: &str| seen.sections.iter().any(|one| one == section);
            match name {
                "failed" => assert!(seen.failures > 0 && seen.counts.contains("iteration_limit"), "{}", seen.counts),
                "single" => {
                    assert!(seen.counts.starts_with("1 of 1 jobs finished: 1 converged") && !shows("h-loads"));
                }
                _ => assert!(
                    seen.counts.starts_with("None of 6") && !["h-jobs", "h-job", "h-loads"].into_iter().any(shows),
                    "{:?}",
                    seen.sections
                ),
            }
            has(&seen.figures, &["Tendon"]);
        }
    }
}
