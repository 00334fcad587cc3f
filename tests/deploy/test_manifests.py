"""What an operator applies: Kubernetes manifests fit their schemas, and every file that names pools, flows, images or passwords agrees."""

import json
import re
from pathlib import Path

import kubernetes_validate
import prefect
import pytest
import yaml

from flows.service.deployments import job_variables, read, with_defaults, with_parameter
from flows.service.parameters import POOLS

DEPLOY = Path(__file__).parents[2] / "deploy"
CONTAINERS = DEPLOY.parent / "containers"
VERSION = "1.32"
MANIFESTS = sorted(p for p in (DEPLOY / "kubernetes").glob("*.yaml") if p.name != "kustomization.yaml")
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())


def documents(path: Path) -> list[dict]:
    return [document for document in yaml.safe_load_all(path.read_text()) if document]


def pods() -> list[tuple[str, dict]]:
    found = [d for path in MANIFESTS for d in documents(path) if d["kind"] in ("Deployment", "StatefulSet", "Job")]
    return [(d["metadata"]["name"], d["spec"]["template"]) for d in found]


def prefects_template() -> dict:
    """What a job in a Kubernetes pool is before we say anything; Prefect brings it along."""
    views = json.loads((Path(prefect.__file__).parent / "server/api/collections_data/views/aggregate-worker-metadata.json").read_text())
    return views["prefect-kubernetes"]["kubernetes"]["default_base_job_configuration"]


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda p: p.name)
def test_manifests_fit_the_schemas_of_kubernetes(path):
    for document in documents(path):
        kubernetes_validate.validate(document, VERSION, strict=True)


def test_a_misspelt_field_is_found():
    document = documents(DEPLOY / "kubernetes/server.yaml")[0]
    document["spec"]["replica"] = 1
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(document, VERSION, strict=True)


def test_the_kustomization_applies_every_manifest_but_the_example():
    applied = set(yaml.safe_load((DEPLOY / "kubernetes/kustomization.yaml").read_text())["resources"])
    assert applied == {p.name for p in MANIFESTS} - {"secrets.example.yaml"}


@pytest.mark.parametrize(("name", "pod"), pods(), ids=lambda x: x if isinstance(x, str) else "")
def test_no_pod_is_root_or_grows(name, pod):
    assert pod["spec"]["securityContext"]["runAsNonRoot"]
    for container in pod["spec"]["containers"]:
        assert container["securityContext"] == {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}}
        assert "memory" in container["resources"]["limits"] and "cpu" in container["resources"]["requests"]


def test_every_pool_has_workers_everywhere():
    assert set(read()["pools"]) == set(POOLS)
    kubernetes = {name for name, _ in pods()} - {"server", "database", "deploy"}
    commands = [service.get("command", []) for service in COMPOSE["services"].values()]
    compose = {command[2] for command in commands if command[:2] == ["physavatar", "worker"]}
    assert kubernetes == compose == set(POOLS)
    assert set(job_variables("docker")) == set(job_variables("kubernetes")) == set(POOLS)


def test_nothing_reserves_a_gpu_while_no_stage_uses_one():
    """Whoever brings a stage to a GPU fails here first, and then gives its pool an image and a request."""
    code = [path for top in ("flows", "tasks", "storage_schemas") for path in (DEPLOY.parent / top).rglob("*.py")]
    assert [path for path in code if re.search(r"\bcuda|gsplat|CUDAExecution", path.read_text())] == []
    described = [*DEPLOY.rglob("*.yaml"), *CONTAINERS.iterdir(), DEPLOY.parent / "pyproject.toml"]
    assert [path for path in described if re.search(r"(?i)nvidia|cuda|gsplat|-gpu\b|\bgpus: *\d", path.read_text())] == []


def test_a_pool_that_asks_for_a_gpu_gets_it_in_its_jobs():
    job = with_defaults(prefects_template(), {"gpus": 1})["job_configuration"]["job_manifest"]["spec"]["template"]["spec"]["containers"][0]
    assert job["resources"]["limits"]["nvidia.com/gpu"] == 1


def test_every_image_that_is_named_is_built():
    built = {path.stem for path in CONTAINERS.glob("*.Dockerfile")}
    named = {
        name
        for path in DEPLOY.rglob("*.yaml")
        for name in re.findall(r"physavatar-(\w+):\d|image: physavatar-(\w+)$|name: physavatar-(\w+), newTag", path.read_text(), re.M)
    }
    assert {"".join(name) for name in named} == built
    assert re.search(r"KINDS:-([\w ]+)}", (CONTAINERS / "build.sh").read_text())[1].split() == sorted(built, reverse=True)


def test_defaults_of_jobs_are_variables_that_prefect_knows():
    known = set(prefects_template()["variables"]["properties"])
    for name, variables in job_variables("kubernetes").items():
        assert set(variables) - {"gpus"} <= known, name


def test_deployments_name_pools_and_queues_that_exist():
    described = read()
    for deployment in described["deployments"]:
        pool = described["pools"][deployment["work_pool"]["name"]]
        assert deployment["work_pool"]["work_queue_name"] in pool["queues"]
    for pool in described["pools"].values():
        single, batch = pool["queues"]["single"], pool["queues"]["batch"]
        assert single["priority"] < batch["priority"]


def test_an_operators_helpers_reach_the_simulation_pool_alone():
    asked = with_parameter(read(), "helpers", 3)["deployments"]
    assert {d["entrypoint"].rpartition(".")[2] for d in asked if d.get("parameters") == {"helpers": 3}} == {"simulation"}
    assert read() == with_parameter(read(), "helpers", 0)


def test_no_password_is_written_down():
    for path in [*MANIFESTS, DEPLOY / "compose.yaml", DEPLOY / "prefect.yaml", DEPLOY / "pools.yaml"]:
        if path.name != "secrets.example.yaml":
            assert not re.search(r"(?i)(password|auth)\S*\s*[:=]\s*[\"']?[a-z0-9]{6,}(?![\w-]*})", _without_references(path.read_text())), (
                path
            )


def _without_references(text: str) -> str:
    return "\n".join(line for line in text.splitlines() if "secretKeyRef" not in line and "${" not in line and not line.startswith("#"))


@pytest.mark.parametrize("path", sorted(CONTAINERS.glob("*.Dockerfile")), ids=lambda p: p.stem)
def test_images_end_without_compilers_root_or_open_base(path):
    text = path.read_text()
    final = text[text.rindex("\nFROM ") :]
    assert "ARG BASE=" in text and text.count("FROM ${BASE}") == 2
    assert not re.search(r"\bgcc\b|-dev\b", final)
    assert "USER 10001" in final and "HEALTHCHECK" in final and 'ENTRYPOINT ["tini"' in final
    assert "compileall" in text and "PYTHONDONTWRITEBYTECODE" not in text
