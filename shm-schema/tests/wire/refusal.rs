//! Services of a program of another version: same names, different layout or quality of service. All are
//! refused.

use foretrace_shm::*;
use iceoryx2::prelude::*;

struct Rig {
    instance: Instance,
    _folder: tempfile::TempDir,
}

impl Rig {
    /// An announced daemon of another version, whose services `make` creates.
    fn run(
        make: impl FnOnce(&Node<ipc::Service>) -> Box<dyn std::any::Any>,
        judge: impl FnOnce(ServiceError),
    ) {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let rig = Self { instance: Instance::at(0, folder.path().join("i")).unwrap(), _folder: folder };
        let mut lock = rig.instance.lock().unwrap();
        {
            let node = NodeBuilder::new().config(rig.instance.config()).create::<ipc::Service>().unwrap();
            let _services = make(&node);
            lock.announce().unwrap();
            let peer = Session::open(&rig.instance, "peer").unwrap();
            judge(Topic::<PenSample>::open(&peer).unwrap_err());
            // A daemon may not take over such services either.
            let daemon = Session::create(&rig.instance, "daemon", &lock).unwrap();
            assert!(Topic::<PenSample>::create(&daemon).is_err());
        }
        assert!(matches!(rig.instance.purge(&lock), Ok(Purge::Removed(_))));
    }
}

type Builder<T> = iceoryx2::service::builder::publish_subscribe::Builder<T, (), ipc::Service>;

fn pen<T: ZeroCopySend + std::fmt::Debug>(node: &Node<ipc::Service>) -> Builder<T> {
    node.service_builder(&PenSample::SERVICE.try_into().unwrap())
        .publish_subscribe::<T>()
        .max_publishers(1)
        .max_subscribers(4)
        .max_nodes(MAX_PEERS)
        .subscriber_max_buffer_size(256)
        .subscriber_max_borrowed_samples(1)
        .history_size(0)
        .enable_safe_overflow(true)
}

fn layout(hash: u64) -> AttributeSpecifier {
    let value = format!("{hash:016x}");
    AttributeSpecifier::new()
        .define(&"foretrace.layout".try_into().unwrap(), &value.as_str().try_into().unwrap())
        .unwrap()
}

#[test]
fn another_type_name_is_refused() {
    #[derive(Debug, ZeroCopySend)]
    #[type_name("foretrace.PenSampleV2")]
    #[repr(C)]
    struct Other([u64; 8]);
    Rig::run(
        |node| Box::new(pen::<Other>(node).create().unwrap()),
        |error| assert!(matches!(error, ServiceError::WrongLayout { .. }), "{error}"),
    );
}

#[test]
fn swapped_fields_under_the_same_name_and_size_are_refused() {
    Rig::run(
        |node| {
            Box::new(
                pen::<PenSample>(node).create_with_attributes(&layout(PenSample::LAYOUT_HASH ^ 1)).unwrap(),
            )
        },
        |error| {
            let theirs_is = format!("{:016x}", PenSample::LAYOUT_HASH ^ 1);
            assert!(
                matches!(&error, ServiceError::WrongLayout { theirs, .. } if *theirs == theirs_is),
                "{error}"
            );
            assert!(error.to_string().contains("one version of foretrace on all sides"), "{error}");
        },
    );
}

#[test]
fn a_service_without_a_layout_hash_is_refused() {
    Rig::run(
        |node| Box::new(pen::<PenSample>(node).create().unwrap()),
        |error| {
            assert!(
                matches!(&error, ServiceError::WrongLayout { theirs, .. } if theirs == "unknown"),
                "{error}"
            )
        },
    );
}

#[test]
fn more_than_the_agreed_quality_of_service_is_refused_too() {
    let good = layout(PenSample::LAYOUT_HASH);
    Rig::run(
        |node| Box::new(pen::<PenSample>(node).max_publishers(5).create_with_attributes(&good).unwrap()),
        |error| {
            let ServiceError::DifferentQos { what, found, expected, .. } = &error else { panic!("{error}") };
            assert_eq!((*what, found.as_str(), *expected), ("publishers", "5", 1));
        },
    );
}

#[test]
fn less_than_the_agreed_quality_of_service_is_refused() {
    let good = layout(PenSample::LAYOUT_HASH);
    Rig::run(
        |node| {
            Box::new(
                pen::<PenSample>(node).subscriber_max_buffer_size(2).create_with_attributes(&good).unwrap(),
            )
        },
        |error| assert!(matches!(error, ServiceError::DifferentQos { what: "buffer size", .. }), "{error}"),
    );
}
