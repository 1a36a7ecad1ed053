"""Builds the parsers' fuzz targets with Clang, runs them, and says what they found: `./rimflow fuzz --help`.

Exit status: 0 nothing found, 1 something found, 2 not built, 77 no Clang with libFuzzer here (CTest: skipped).
"""
import argparse
import concurrent.futures
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

here = pathlib.Path(__file__).resolve().parent
source = here.parents[1]
SKIPPED = 77


def clang():
    """A clang++ that has libFuzzer, the sanitizers and OpenMP; None where there is none."""
    program = 'extern "C" int LLVMFuzzerTestOneInput(const unsigned char*, unsigned long) { return 0; }'
    for name in [os.environ.get('RIMFLOW_CLANG', 'clang++'), *(f'clang++-{version}' for version in range(21, 11, -1))]:
        if not shutil.which(name):
            continue
        with tempfile.TemporaryDirectory() as folder:
            command = [name, '-x', 'c++', '-', '-fsanitize=fuzzer,address,undefined', '-fopenmp', '-o', f'{folder}/target']
            if subprocess.run(command, input=program, text=True, capture_output=True).returncode == 0:
                return name
    return None


def build(compiler, folder):
    """The names of the targets."""
    configure = ['cmake', '-S', source, '-B', folder, '-G', 'Ninja', f'-DCMAKE_CXX_COMPILER={compiler}', '-DRIMFLOW_BUILD_VTK=OFF',
                 '-DBUILD_TESTING=OFF', '-DRIMFLOW_BUILD_FUZZERS=ON']
    for command in (configure, ['cmake', '--build', folder, '--target', 'fuzzers']):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            print(done.stdout[-4000:], file=sys.stderr)
            sys.exit(2)
    return sorted(p.name[len('Fuzz_'):] for p in (folder / 'bin').glob('Fuzz_*'))


def fuzz(name, folder, seconds, seed):
    """One target for some seconds; new inputs go to <folder>/found/<name>/, what fails to <folder>/failed/."""
    found, failed = folder / 'found' / name, folder / 'failed'
    found.mkdir(parents=True, exist_ok=True)
    failed.mkdir(exist_ok=True)
    log = folder / 'logs' / f'{name}.log'
    log.parent.mkdir(exist_ok=True)
    command = [folder / 'bin' / f'Fuzz_{name}', f'-max_total_time={seconds}', f'-seed={seed}', '-timeout=10', '-rss_limit_mb=2048',
               '-malloc_limit_mb=256', '-max_len=2048', '-entropic=0', '-print_final_stats=1', f'-artifact_prefix={failed}/{name}-']
    words = here / 'dictionaries' / f'{name}.txt'
    command += [f'-dict={words}'] if words.exists() else []
    command += [found, here / 'corpus' / name]
    environment = dict(os.environ, OMP_NUM_THREADS='1', OMP_WAIT_POLICY='passive', UBSAN_OPTIONS='print_stacktrace=1',
                       ASAN_OPTIONS='malloc_context_size=4:quarantine_size_mb=16')
    with open(log, 'w') as to:
        status = subprocess.run(command, stdout=to, stderr=subprocess.STDOUT, env=environment).returncode
    text = log.read_text(errors='replace')
    executions = re.search(r'stat::number_of_executed_units: (\d+)', text)
    coverage = re.findall(r' cov: (\d+) ', text)
    reason = re.search(r'NOT TRUE: .*|runtime error: .*|ERROR: .*|ALARM: .*', text)
    return {'name': name, 'executions': int(executions[1]) if executions else 0, 'edges': int(coverage[-1]) if coverage else 0,
            'failed': status != 0, 'reason': reason[0] if reason else f'exit status {status}', 'log': log,
            'input': re.findall(r'Test unit written to (.*)', text)}


def main():
    parser = argparse.ArgumentParser(description='Fuzzes the parsers of track files.')
    parser.add_argument('formats', nargs='*', metavar='FORMAT', help='which ones (default: all)')
    parser.add_argument('--minutes', type=float, default=60, help='time for all of them together (default: 60)')
    parser.add_argument('--jobs', type=int, default=min(2, os.cpu_count() or 1), help='how many at a time (default: 2)')
    parser.add_argument('--seed', type=int, default=0, help='of the random changes (default: another one each time)')
    parser.add_argument('--build', type=pathlib.Path, default=source / 'build-fuzz', help='build folder (default: build-fuzz)')
    given = parser.parse_args()
    compiler = clang()
    if not compiler:
        print('fuzz: skipped, because there is no Clang with libFuzzer, AddressSanitizer and OpenMP here (Debian: clang, libclang-rt-dev, '
              'libomp-dev).')
        return SKIPPED
    folder = given.build.resolve()
    targets = build(compiler, folder)
    unknown = set(given.formats) - set(targets)
    if unknown:
        parser.error(f'there is no format {", ".join(sorted(unknown))}; there are {", ".join(targets)}')
    chosen = given.formats or targets
    seconds = max(1, round(60 * given.minutes * given.jobs / len(chosen)))
    print(f'{"format":20} {"executions":>12} {"edges":>7}  found')
    failures = []
    with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
        for result in pool.map(lambda name: fuzz(name, folder, seconds, given.seed), chosen):
            print(f'{result["name"]:20} {result["executions"]:12,} {result["edges"]:7,}  {result["reason"] if result["failed"] else "nothing"}',
                  flush=True)
            failures += [result] if result['failed'] else []
    for result in failures:
        again = ' '.join([str(folder / 'bin' / f'Fuzz_{result["name"]}'), *result['input']])
        print(f'\n{result["name"]}: {result["reason"]}\n  log: {result["log"]}\n  again: {again}')
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
